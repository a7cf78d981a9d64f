// SPDX-License-Identifier: MIT
#include "acquire/run/disk.hpp"

#include <fcntl.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <iterator>

#include "drivers/core/random.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/output_queue.hpp"

namespace echofuse::acquire {
namespace {

// Size in bytes of the database row and the events of a record, without sensor data.
constexpr double row_bytes = 2048;
// Total size in bytes of the WAL and of a run file without records.
constexpr double fixed_bytes = 16 << 20;
// Every byte is written twice: to the WAL, then to the database.
constexpr double journal_factor = 2;

[[noreturn]] void fail(const std::string& folder, const char* doing) {
  throw Error(ExitCode::disk, folder + ": " + doing + ": " + std::strerror(errno));
}

class NamelessFile {
 public:
  explicit NamelessFile(const std::string& folder) : folder_(folder) {
    std::string name = folder + "/.echofuse-doctor-XXXXXX";
    fd_ = ::mkostemp(name.data(), O_CLOEXEC);
    if (fd_ < 0) fail(folder_, "cannot create a file");
    ::unlink(name.c_str());
  }
  ~NamelessFile() { ::close(fd_); }
  NamelessFile(const NamelessFile&) = delete;
  NamelessFile& operator=(const NamelessFile&) = delete;

  void commit(const std::vector<char>& block, off_t at) {
    ::lseek(fd_, at, SEEK_SET);
    if (const int error = write_all(fd_, {block.data(), block.size()}); error != 0)
      errno = error, fail(folder_, "cannot write");
    if (::fdatasync(fd_) != 0) fail(folder_, "cannot write to the disk");
  }

 private:
  std::string folder_;
  int fd_;
};

std::vector<char> incompressible(std::size_t size) {
  std::vector<char> block(size);
  Rng rng = make_rng(1, 1);
  for (char& c : block) c = static_cast<char>(rng());
  return block;
}

}  // namespace

DiskEstimate estimate_disk(const PlannedRun& plan, double free_bytes) {
  DiskEstimate out{.record_bytes = plan.record_bytes + row_bytes};
  if (plan.count)
    out.needed_bytes = static_cast<double>(*plan.count) * out.record_bytes + fixed_bytes;
  out.lasts_s = std::max(0.0, (free_bytes - fixed_bytes) / out.record_bytes) * plan.window_s;
  return out;
}

std::optional<std::uint64_t> free_bytes(const std::string& folder) {
  struct statvfs disk {};
  if (::statvfs(folder.c_str(), &disk) != 0) return std::nullopt;
  return std::uint64_t{disk.f_bavail} * disk.f_frsize;
}

std::string size_text(double bytes) {
  constexpr const char* units[] = {"B", "kB", "MB", "GB", "TB"};
  std::size_t unit = 0;
  for (; bytes >= 1000 && unit + 1 < std::size(units); ++unit) bytes /= 1000;
  return format(bytes < 10 ? "%.1f %s" : "%.0f %s", bytes, units[unit]);
}

DiskSpeed measure_disk(const std::string& folder, std::size_t commit_bytes) {
  using SteadyClock = std::chrono::steady_clock;
  constexpr auto time_limit = std::chrono::seconds(1);
  constexpr std::size_t file_limit = 64u << 20, min_commits = 5;
  NamelessFile file(folder);
  const std::vector<char> block = incompressible(commit_bytes);
  const std::size_t places = std::max<std::size_t>(1, file_limit / commit_bytes);
  std::vector<double> times;
  const auto start = SteadyClock::now();
  while (times.size() < min_commits || SteadyClock::now() - start < time_limit) {
    const auto before = SteadyClock::now();
    file.commit(block, static_cast<off_t>(times.size() % places * commit_bytes));
    times.push_back(std::chrono::duration<double>(SteadyClock::now() - before).count());
  }
  const double total = std::chrono::duration<double>(SteadyClock::now() - start).count();
  DiskSpeed speed{.bytes_per_s = static_cast<double>(times.size() * commit_bytes) / total,
                  .commit_bytes = commit_bytes};
  std::sort(times.begin(), times.end());
  speed.commit_median_s = times[times.size() / 2];
  speed.commit_longest_s = times.back();
  return speed;
}

Finding speed_finding(const DiskSpeed& speed, const PlannedRun& plan) {
  const bool known = plan.record_bytes > 0;
  const double needed =
      known ? journal_factor * estimate_disk(plan, 0).record_bytes / plan.window_s : 0;
  constexpr double reserve = 4;
  Grade grade = Grade::ok;
  if (known && (speed.bytes_per_s < reserve * needed || speed.commit_longest_s > plan.window_s))
    grade = Grade::warning;
  if (known && (speed.bytes_per_s < needed || speed.commit_median_s > plan.window_s))
    grade = Grade::problem;
  const std::string commits = format("/s in commits of %s (median %.3g ms, longest %.3g ms)",
                                     size_text(static_cast<double>(speed.commit_bytes)).c_str(),
                                     1e3 * speed.commit_median_s, 1e3 * speed.commit_longest_s);
  return {"disk rate",
          grade,
          plan.folder + ": " + size_text(speed.bytes_per_s) + commits +
              (known ? "; the run needs " + size_text(needed) + "/s" : ""),
          grade == Grade::ok ? "" : "record to another disk, or increase run.window_s",
          {{"bytes_per_s", speed.bytes_per_s},
           {"needed_bytes_per_s", needed},
           {"commit_bytes", static_cast<double>(speed.commit_bytes)},
           {"commit_median_s", speed.commit_median_s},
           {"commit_longest_s", speed.commit_longest_s}},
          ExitCode::disk};
}

Finding space_finding(double free_bytes, const PlannedRun& plan, double short_s) {
  Finding out{.check = "disk space",
              .found = plan.folder + ": " + size_text(free_bytes) + " free",
              .facts = {{"free_bytes", free_bytes}},
              .failure = ExitCode::disk};
  if (plan.record_bytes <= 0) return out;
  const DiskEstimate estimate = estimate_disk(plan, free_bytes);
  out.facts.emplace_back("record_bytes", estimate.record_bytes);
  out.facts.emplace_back("lasts_s", estimate.lasts_s);
  const std::string of_size = " of " + size_text(estimate.record_bytes) + " each";
  if (plan.count) {
    out.facts.emplace_back("needed_bytes", estimate.needed_bytes);
    out.found += "; " + std::to_string(*plan.count) + " records" + of_size +
                 ", including the journal, need " + size_text(estimate.needed_bytes);
    if (estimate.needed_bytes > free_bytes) out.grade = Grade::problem;
  } else {
    out.found += ": enough for " + human_duration(estimate.lasts_s) + " of records" + of_size;
    if (estimate.lasts_s < short_s) out.grade = Grade::warning;
  }
  if (out.grade != Grade::ok) out.advice = "free some space, or record to another disk";
  return out;
}

std::vector<Finding> check_disk(const PlannedRun& plan) {
  constexpr double unknown_bytes = 256 << 10;
  const double size = plan.record_bytes > 0 ? estimate_disk(plan, 0).record_bytes : unknown_bytes;
  std::vector<Finding> out;
  try {
    const auto free = free_bytes(plan.folder);
    if (!free) fail(plan.folder, "cannot be used for a run");
    out.push_back(speed_finding(measure_disk(plan.folder, static_cast<std::size_t>(size)), plan));
    out.push_back(space_finding(static_cast<double>(*free), plan));
  } catch (const Error& e) {
    out.push_back({"disk",
                   Grade::problem,
                   e.what(),
                   "choose --out in a writable folder on a local disk",
                   {},
                   ExitCode::disk});
  }
  return out;
}

}  // namespace echofuse::acquire

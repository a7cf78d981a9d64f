// SPDX-License-Identifier: MIT
#include "acquire/disk.hpp"

#include <fcntl.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "drivers/core/console.hpp"
#include "drivers/core/random.hpp"

namespace echofuse::acquire {
namespace {

constexpr double journal_factor = 2;      // every byte goes into the WAL and then into the database
constexpr double row_bytes = 2048;        // of a record beside its sensors' data, with events
constexpr double fixed_bytes = 16 << 20;  // the WAL, and the tables of a run without records

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
    for (std::size_t done = 0; done < block.size();) {
      const ssize_t n =
          ::pwrite(fd_, block.data() + done, block.size() - done, at + static_cast<off_t>(done));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) fail(folder_, "cannot write");
      done += static_cast<std::size_t>(n);
    }
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

std::string size_text(double bytes) {
  constexpr const char* units[] = {"B", "kB", "MB", "GB", "TB"};
  std::size_t unit = 0;
  for (; bytes >= 1000 && unit + 1 < std::size(units); ++unit) bytes /= 1000;
  char text[32];
  std::snprintf(text, sizeof text, bytes < 10 ? "%.1f %s" : "%.0f %s", bytes, units[unit]);
  return text;
}

double bytes_on_disk(const PlannedRun& plan) { return plan.record_bytes + row_bytes; }

}  // namespace

DiskSpeed measure_disk(const std::string& folder, std::size_t commit_bytes) {
  using Clock = std::chrono::steady_clock;
  constexpr auto time_limit = std::chrono::seconds(1);
  constexpr std::size_t file_limit = 64u << 20, min_commits = 5;
  NamelessFile file(folder);
  const std::vector<char> block = incompressible(commit_bytes);
  const std::size_t places = std::max<std::size_t>(1, file_limit / commit_bytes);
  std::vector<double> times;
  const auto start = Clock::now();
  while (times.size() < min_commits || Clock::now() - start < time_limit) {
    const auto before = Clock::now();
    file.commit(block, static_cast<off_t>(times.size() % places * commit_bytes));
    times.push_back(std::chrono::duration<double>(Clock::now() - before).count());
  }
  const double total = std::chrono::duration<double>(Clock::now() - start).count();
  DiskSpeed speed{.bytes_per_s = static_cast<double>(times.size() * commit_bytes) / total,
                  .commit_bytes = commit_bytes};
  std::sort(times.begin(), times.end());
  speed.commit_median_s = times[times.size() / 2];
  speed.commit_longest_s = times.back();
  return speed;
}

Finding judge_speed(const DiskSpeed& speed, const PlannedRun& plan) {
  const bool known = plan.record_bytes > 0;
  const double needed = known ? journal_factor * bytes_on_disk(plan) / plan.window_s : 0;
  constexpr double reserve = 4;
  Grade grade = Grade::ok;
  if (known && (speed.bytes_per_s < reserve * needed || speed.commit_longest_s > plan.window_s))
    grade = Grade::warning;
  if (known && (speed.bytes_per_s < needed || speed.commit_median_s > plan.window_s))
    grade = Grade::problem;
  char commits[120];
  std::snprintf(commits, sizeof commits, "/s in commits of %s (median %.3g ms, longest %.3g ms)",
                size_text(static_cast<double>(speed.commit_bytes)).c_str(),
                1e3 * speed.commit_median_s, 1e3 * speed.commit_longest_s);
  return {"disk rate",
          grade,
          plan.folder + ": " + size_text(speed.bytes_per_s) + commits +
              (known ? "; the run needs " + size_text(needed) + "/s" : ""),
          grade == Grade::ok ? "" : "record to another disk, or make run.window_s longer",
          {{"bytes_per_s", speed.bytes_per_s},
           {"needed_bytes_per_s", needed},
           {"commit_bytes", static_cast<double>(speed.commit_bytes)},
           {"commit_median_s", speed.commit_median_s},
           {"commit_longest_s", speed.commit_longest_s}},
          ExitCode::disk};
}

Finding judge_room(double free_bytes, const PlannedRun& plan) {
  Finding out{.check = "disk room",
              .found = plan.folder + ": " + size_text(free_bytes) + " free",
              .facts = {{"free_bytes", free_bytes}},
              .failure = ExitCode::disk};
  if (plan.record_bytes <= 0) return out;
  constexpr double short_s = 3600;
  const double records = std::max(0.0, (free_bytes - fixed_bytes) / bytes_on_disk(plan));
  const double lasts_s = records * plan.window_s;
  out.facts.emplace_back("record_bytes", bytes_on_disk(plan));
  out.facts.emplace_back("lasts_s", lasts_s);
  const std::string of_size = " of " + size_text(bytes_on_disk(plan)) + " each";
  if (plan.count) {
    const double planned = static_cast<double>(*plan.count);
    const double needed = planned * bytes_on_disk(plan) + fixed_bytes;
    out.facts.emplace_back("needed_bytes", needed);
    out.found +=
        "; " + std::to_string(*plan.count) + " records" + of_size + " take " + size_text(needed);
    if (records < planned) out.grade = Grade::problem;
  } else {
    out.found += ": enough for " + human_duration(lasts_s) + " of records" + of_size;
    if (lasts_s < short_s) out.grade = Grade::warning;
  }
  if (out.grade != Grade::ok) out.advice = "make room, or record to another disk";
  return out;
}

std::vector<Finding> check_disk(const PlannedRun& plan) {
  constexpr double unknown_bytes = 256 << 10;
  const double size = plan.record_bytes > 0 ? bytes_on_disk(plan) : unknown_bytes;
  std::vector<Finding> out;
  try {
    struct statvfs room {};
    if (::statvfs(plan.folder.c_str(), &room) != 0) fail(plan.folder, "cannot be a run's folder");
    out.push_back(judge_speed(measure_disk(plan.folder, static_cast<std::size_t>(size)), plan));
    out.push_back(
        judge_room(static_cast<double>(room.f_bavail) * static_cast<double>(room.f_frsize), plan));
  } catch (const Error& e) {
    out.push_back({"disk",
                   Grade::problem,
                   e.what(),
                   "give --out in a folder of a local disk that this user may write to",
                   {},
                   ExitCode::disk});
  }
  return out;
}

}  // namespace echofuse::acquire

// SPDX-License-Identifier: MIT
#include "recon/live/followed_run.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "acquire/record/run_names.hpp"
#include "acquire/record/writer_lock.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::view {
namespace {

namespace fs = std::filesystem;
constexpr std::size_t max_events = 40;

std::int64_t changed_ns(const struct stat& file) {
  return file.st_mtim.tv_sec * std::int64_t{1'000'000'000} + file.st_mtim.tv_nsec;
}

// Returns the start time of the run; empty if the file cannot be read as a run.
std::string start_of(const std::string& path) {
  try {
    return record::RunReader(path).info().started_utc;
  } catch (const Error&) {
    return {};
  }
}

}  // namespace

FileStamp stamp_of(const std::string& path) {
  FileStamp out;
  const std::string file_path = real_path(path);
  for (const char* suffix : {"", "-wal"}) {
    struct stat file {};
    if (::stat((file_path + suffix).c_str(), &file) != 0) continue;
    if (!*suffix) out.inode = file.st_ino;
    out.bytes += static_cast<std::uint64_t>(file.st_size);
    out.changed_ns = std::max(out.changed_ns, changed_ns(file));
  }
  out.written = out.inode != 0 && record::WriterLock::someone_writes(path);
  return out;
}

// Returns the path of the run that started last; empty if the folder contains no run. Reads a file
// again only if it has changed. Reads the file of a live run only once, because its start time does
// not change.
std::string FollowedRun::newest_file() {
  std::error_code none;
  std::map<std::string, FolderEntry> begun;
  std::pair<std::string, std::string> newest;  // start time and path of the newest run
  for (fs::directory_iterator it(target_, none), end; it != end; it.increment(none)) {
    const std::string path = it->path().string();
    if (it->path().extension() != ".sqlite" || !it->is_regular_file(none)) continue;
    const FileStamp stamp = stamp_of(path);
    FolderEntry& file = begun[path] = begun_[path];
    const bool live = file.stamp.written && stamp.written && file.stamp.inode == stamp.inode;
    if (file.stamp != stamp && (file.utc.empty() || !live)) file = {stamp, start_of(path)};
    if (!file.utc.empty()) newest = std::max(newest, std::pair(file.utc, path));
  }
  begun_ = std::move(begun);
  return newest.second;
}

// Returns the path of the run file; empty if the file does not exist.
std::string FollowedRun::find() {
  std::error_code none;
  if (fs::is_directory(target_, none)) return newest_file();
  const std::string run = record::old_run(target_);
  return fs::exists(run, none) ? run : "";
}

bool FollowedRun::refresh() {
  const std::string path = find();
  const FileStamp stamp = stamp_of(path);
  if (path == path_ && stamp == stamp_ && !path.empty() && trouble_.empty()) return false;
  if (path != path_ || stamp.inode != stamp_.inode) forget();
  const std::string before = std::exchange(trouble_, {});
  path_ = path, stamp_ = stamp;
  try {
    if (path.empty())
      trouble_ = printable(target_) + ": the run does not exist yet; waiting for it";
    else
      read();
  } catch (const std::exception& e) {
    trouble_ = e.what();
  }
  if (!before.empty() && trouble_.empty()) ++edition_;
  return trouble_.empty() || trouble_ != before;
}

void FollowedRun::forget() {
  info_ = {};
  axes_.clear(), events_.clear(), outlines_.clear(), label_.clear();
  sensors_ = {}, verdicts_ = {};
  ++edition_;
}

void FollowedRun::read() {
  const record::RunReader run(path_);
  const record::RunInfo info = run.info();
  std::vector<Axis> axes = run.axes();
  const bool same_axes =
      axes.size() == axes_.size() && std::equal(axes.begin(), axes.end(), axes_.begin(), same_axis);
  if (info.uuid != info_.uuid)
    forget();
  else if (info.status != info_.status || !same_axes)
    ++edition_;
  info_ = info, axes_ = std::move(axes);
  events_ = run.last_events(max_events);
  for (const record::FusedRecord& o : run.outlines(last().value_or(-1) + 1)) take(o);
  const auto late = run.late();
  for (const Sensor s : all_sensors)
    sensors_[s].late = static_cast<std::uint64_t>(std::max<std::int64_t>(late[s], 0));
}

void FollowedRun::take(const record::FusedRecord& o) {
  Outline& out = outlines_.emplace_back();
  out.index = o.index, out.start = o.slot_utc, out.end = o.slot_utc + (o.slot_end - o.slot_start);
  out.valid = o.valid;
  label_ = o.label;
  PerSensor<record::Verdict> verdicts;
  for (const Sensor s : all_sensors) {
    SensorState& sensor = sensors_[s];
    sensor.verdict = verdicts[s] = o.sync[s].verdict;
    sensor.configured = sensor.verdict.kind != record::VerdictKind::not_configured;
    sensor.valid = o.valid.contains(s);
    if (o.sync[s].doubtful()) sensor.last_doubtful = outlines_.size() - 1, out.doubtful = true;
    if (sensor.valid) sensor.last_valid = out.end;
    sensor.missing += sensor.configured && !sensor.valid ? 1 : 0;
    sensor.used = static_cast<double>(o.sync[s].used);
    sensor.lost += o.sync[s].lost;
    // The clock residual of a sensor without valid data is unknown, although its clock fit
    // continues.
    const std::optional<double> residual_s =
        sensor.valid && o.clocks[s] ? std::optional(o.clocks[s]->residual_s) : std::nullopt;
    sensor.residual_s = residual_s;
    out.used[s] = static_cast<float>(o.sync[s].used);
    out.lost[s] = static_cast<float>(o.sync[s].lost);
    out.residual_s[s] =
        static_cast<float>(residual_s.value_or(std::numeric_limits<double>::quiet_NaN()));
  }
  sensors_[Sensor::radar].arrived = static_cast<std::int64_t>(o.statistics.radar_frames);
  sensors_[Sensor::depth].arrived = static_cast<std::int64_t>(o.statistics.depth_frames);
  if (o.radar_temperature) out.radar_c = std::ranges::max(o.radar_temperature->celsius);
  if (o.radar_stats)
    out.margin_ms = static_cast<float>(o.radar_stats->inter_frame_margin_us) * 1e-3F;
  verdicts_.add(verdicts);
}

std::optional<std::int64_t> FollowedRun::last() const {
  if (outlines_.empty()) return std::nullopt;
  return outlines_.back().index;
}

std::optional<std::uint64_t> FollowedRun::free_bytes() const {
  std::error_code failed;
  const auto space = fs::space(fs::absolute(path_, failed).parent_path(), failed);
  if (failed) return std::nullopt;
  return space.available;
}

void FollowedRun::with_reader(const ReadAction& use) const {
  if (!trouble_.empty() || path_.empty()) throw Error(ExitCode::failed, trouble_);
  use(record::RunReader(path_));
}

std::optional<double> age_s(const SensorState& sensor, UtcTime now) {
  if (!sensor.last_valid) return std::nullopt;
  return std::max(0.0, seconds(now - *sensor.last_valid));
}

// The age limit includes 0.5 s, because the acquisition program writes a record 0.5 s after the end
// of its slot.
bool is_stale(const SensorState& sensor, double window_s, UtcTime now) {
  constexpr double grace_s = 0.5;
  const auto age = age_s(sensor, now);
  return !age || *age > 2 * window_s + grace_s;
}

}  // namespace echofuse::view

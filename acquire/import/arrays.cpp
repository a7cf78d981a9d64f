// SPDX-License-Identifier: MIT
#include <charconv>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include "acquire/import/array_folder.hpp"
#include "acquire/import/import.hpp"
#include "acquire/import/imported_run.hpp"
#include "acquire/intake/signal_check.hpp"
#include "acquire/measurement/response.hpp"
#include "acquire/record/columns.hpp"
#include "acquire/record/run_reader.hpp"
#include "acquire/record/run_writer.hpp"
#include "acquire/run/new_run.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/new_file.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/program.hpp"

namespace echofuse::acquire {
namespace {

namespace fs = std::filesystem;

// Formats a number with the fewest digits that identify its value exactly.
std::string shortest_text(double value) {
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

std::vector<std::pair<std::string, std::string>> stated(const ArraySettings& s) {
  std::vector<std::pair<std::string, std::string>> given;
  if (s.irf_fwhm_ps > 0)
    given = {{"irf_fwhm_ps", shortest_text(s.irf_fwhm_ps)}, {"irf_tail_ps", "0"}};
  if (!record::is_response(given))
    throw Error(ExitCode::config, format("spd.irf_fwhm_ps: expected %g to %g, or 0 if unknown",
                                         record::min_width_ps, record::max_width_ps));
  if (const auto fault = record::fault_of_width(given, s.bin_width_ps); !fault.empty())
    throw Error(ExitCode::config, "spd." + fault);
  if (!s.radar_taps.empty() || s.radar_cell_m > 0) {
    given.emplace_back("radar_cell_m", shortest_text(s.radar_cell_m));
    given.emplace_back("radar_taps", s.radar_taps);
  }
  if (!record::is_response(given))
    throw Error(ExitCode::config,
                "radar.taps: expected 3 to 64 numbers from 0 to 1.05 with a peak of 1, and "
                "radar.cell_m above 0");
  auto known = record::response_of(given).meta();
  for (auto& [key, text] : known)
    for (const auto& [name, as_given] : given)
      if (name == key) text = as_given;
  return known;
}

record::RunInfo info_of(const ArraySettings& s, const Settings& settings, const std::string& text) {
  record::RunInfo info;
  info.config_text = text;
  info.config_resolved = settings.resolved();
  info.version = version();
  info.host = machine_name();
  info.operator_name = login_name();
  info.notes = s.notes;
  info.window_s = s.window_s;
  info.meta = stated(s);
  return info;
}

// Returns the metadata of the source run (key `run` of run.toml) for a new run.
record::RunInfo info_of(const record::RunReader& base) {
  record::RunInfo info = base.info();
  info.uuid.clear(), info.ended_utc.clear();
  info.status = "open";
  return info;
}

void put_calibrations(record::RunWriter& run, std::vector<record::CalibrationEntry> entries,
                      const ArraySettings& s) {
  for (const Sensor sensor : {Sensor::spd, Sensor::radar}) {
    if (s.offset_m[sensor] == 0) continue;
    const auto found = std::ranges::find(entries, sensor, &record::CalibrationEntry::sensor);
    if (found != entries.end())
      found->offset_m += s.offset_m[sensor];
    else
      entries.push_back({sensor, "", "stated", 0, s.offset_m[sensor], 0});
  }
  for (const auto& entry : entries) run.put_calibration(entry);
}

record::FusedRecord fresh(std::size_t row, double window_s, UtcTime began) {
  record::FusedRecord r;
  r.index = static_cast<std::int64_t>(row);
  r.slot_start = from_seconds(window_s * static_cast<double>(row));
  r.slot_end = from_seconds(window_s * static_cast<double>(row + 1));
  r.slot_utc = began + r.slot_start;
  return r;
}

RunStart beginning_of(const std::optional<UtcTime>& given, const record::RunReader* base,
                      const ArrayFolder& arrays) {
  if (base && given)
    throw Error(ExitCode::usage,
                "--began cannot be combined with `run`, because that run has a start time");
  if (base) return {parse_utc(base->info().started_utc), {}};
  if (given) return {*given, {}};
  const std::string file = fs::path(arrays.newest()).filename().string();
  return {modified(arrays.newest()), "start time unknown: the modification time of " + file +
                                         " is used; set it with --began UTC"};
}

// Writes the run. Its records get the same verdicts as those of a live run. Threading: one thread.
class ArrayRun {
 public:
  // Throws Error(failed) if `out` exists, or Error(disk) if it cannot be written.
  ArrayRun(const std::string& out, const record::RunInfo& info, std::vector<Axis> axes,
           const RunStart& began, const SignalLimits& limits, const record::RunWriter::Begin& begin)
      : file_((refuse_bad_target(out), out), NewFile::Staged{}),
        check_(limits, info.window_s),
        axes_(std::move(axes)) {
    refuse_late_clock(began.utc);
    clock_.utc_at = began.utc;
    run_.emplace(file_.path(), info, clock_, begin);
    run_->put_anchor({}, began.utc);
    if (!began.doubt.empty()) doubt(began.doubt);
    for (const Axis& axis : axes_) run_->put_axis(axis);
  }
  void put(record::FusedRecord record) {
    check_.assess(record, axes_);
    clock_.at = std::max(clock_.at, record.slot_end);
    clock_.utc_at =
        std::max(clock_.utc_at, record.slot_utc + (record.slot_end - record.slot_start));
    record::for_each_column([&](const auto& column, std::size_t) {
      batch_bytes_ += as_bytes(record.*column.values).size();
    });
    batch_.push_back(std::move(record));
    constexpr std::size_t max_records = 256, max_bytes = 4 << 20;
    if (batch_.size() == max_records || batch_bytes_ > max_bytes) flush();
  }
  // Adds a warning to the run and to the lines returned by finish().
  void doubt(const std::string& text) {
    run_->put_event(clock_.utc(), Severity::warning, "import", text);
    lines_.append("\n").append(printable(text));
  }
  // Returns the result of publish_import(), then the warnings, one per line.
  std::string finish() {
    flush();
    run_->close_as_one_file("complete");
    return publish_import(file_, lines_) + lines_;
  }

 private:
  // Clock that returns the time of the recording, which is stored in the run's metadata.
  struct RecordingClock final : Clock {
    HostTime now() const override { return at; }
    UtcTime utc() const override { return utc_at; }
    UtcTime utc_at{};
    HostTime at{};
  };
  // Writes the batch in one transaction, because each transaction waits for the disk.
  void flush() {
    run_->append(batch_);
    batch_.clear(), batch_bytes_ = 0;
  }

  NewFile file_;
  RecordingClock clock_;
  SignalCheck check_;
  std::optional<record::RunWriter> run_;
  std::vector<Axis> axes_;
  std::vector<record::FusedRecord> batch_;  // records not yet written
  std::size_t batch_bytes_ = 0;
  std::string lines_;
};

}  // namespace

std::string import_arrays(const std::string& folder, const std::string& out,
                          std::optional<UtcTime> began) {
  const std::string path = (fs::path(folder) / "run.toml").string();
  const std::string text = read_config_text(path);
  ArraySettings s;
  Settings settings;
  bind(settings, s);
  settings.read_text(text, path);
  ArrayFolder arrays(folder, s);
  std::optional<record::RunReader> base;
  if (!s.run.empty()) base.emplace((fs::path(folder) / s.run).string());
  const record::RunInfo info = base ? info_of(*base) : info_of(s, settings, text);
  const std::vector<Axis> axes = base ? base->axes() : arrays.axes();
  arrays.require_shapes(axes);

  const RunStart start = beginning_of(began, base ? &*base : nullptr, arrays);
  ArrayRun import(out, info, axes, start, s.limits, [&](record::RunWriter& run) {
    const auto antennas = base ? base->antennas() : arrays.antennas();
    if (!antennas.empty()) run.put_antennas(antennas);
    put_calibrations(run, base ? base->calibrations() : std::vector<record::CalibrationEntry>{}, s);
    if (base)
      for (const DeviceInfo& device : base->devices()) run.put_device(device);
  });
  Progress progress("import", arrays.rows(), false);
  for (std::size_t row = 0; row < arrays.rows(); ++row) {
    if (interrupted()) throw Error(ExitCode::interrupted, "interrupted; nothing was written");
    const std::int64_t index = arrays.next_index();
    record::FusedRecord r = base ? base->read(index) : fresh(row, info.window_s, start.utc);
    arrays.take_row(r);
    import.put(std::move(r));
    progress.update(row + 1);
  }
  for (const std::string& doubt : arrays.doubts()) import.doubt(doubt);
  return import.finish();
}

}  // namespace echofuse::acquire

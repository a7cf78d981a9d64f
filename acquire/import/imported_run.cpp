// SPDX-License-Identifier: MIT
#include "acquire/import/imported_run.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <utility>

#include "acquire/record/columns.hpp"
#include "acquire/record/written_run.hpp"
#include "acquire/run/new_run.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {

UtcTime modified(const std::string& path) {
  struct stat found {};
  if (::stat(path.c_str(), &found) != 0) return {};
  return std::chrono::seconds(found.st_mtim.tv_sec) +
         std::chrono::nanoseconds(found.st_mtim.tv_nsec);
}

ImportedRun::ImportedRun(const std::string& out, const RunStart& began, const SignalCheck& check,
                         const MakeWriter& make)
    : file_((refuse_bad_target(out), out), NewFile::Staged{}), check_(check) {
  refuse_late_clock(began.utc);
  clock_.began = clock_.utc_at = began.utc;
  run_ = make(file_.path(), clock_);
  run_->put_anchor({}, began.utc);
  if (!began.doubt.empty()) doubt(began.doubt);
}

void ImportedRun::put_axes(const std::vector<Axis>& axes) {
  axes_ = axes;
  for (const Axis& axis : axes_) run_->put_axis(axis);
}

void ImportedRun::put(record::FusedRecord record, const SignalCheck::RecordingEnds& ends) {
  check_.assess(record, axes_, ends);
  clock_.at = std::max(clock_.at, record.slot_end);
  clock_.utc_at = std::max(clock_.utc_at, record.slot_utc + (record.slot_end - record.slot_start));
  for (const Sensor s : all_sensors) {
    valid_[s] += record.has(s);
    if (!record.has(s)) causes_[s] = record.sync[s].cause();
  }
  tags_ += record.spd_counts;
  record::for_each_column([&](const auto& column, std::size_t) {
    batch_bytes_ += as_bytes(record.*column.values).size();
  });
  batch_.push_back(std::move(record));
  if (constexpr std::size_t most = 256, most_bytes = 4 << 20;
      batch_.size() == most || batch_bytes_ > most_bytes)
    flush();
}

// Writes the batch in one transaction, because each transaction waits for the disk.
void ImportedRun::flush() {
  run_->append(batch_);
  batch_.clear(), batch_bytes_ = 0;
}

void ImportedRun::doubt(const std::string& text) {
  run_->put_event(clock_.utc(), Severity::warning, "import", text);
  lines_.append("\n").append(printable(text));
}

void ImportedRun::put_counters(Sensor sensor, const std::vector<Counter>& counters) {
  for (const Counter& c : counters) counted_.push_back({name_of(sensor), c.name, c.value});
}

std::string ImportedRun::finish() {
  flush();
  run_->put_counters(counted_);
  std::string counts, causes;
  for (const Sensor s : all_sensors) {
    if (valid_[s] > 0)
      counts.append(", ").append(name_of(s)).append(" in ").append(std::to_string(valid_[s]));
    else if (!causes_[s].empty())
      causes.append("; ").append(name_of(s)).append(": ").append(causes_[s]);
  }
  const std::string text = std::to_string(run_->records()) + " records" + counts;
  if (counts.empty())
    throw Error(ExitCode::failed, printable(file_.place()) + ": nothing to import: " +
                                      printable(text + causes) + "; no record contains valid data");
  run_->close_as_one_file("complete");
  record::check_written_run(file_.path(), printable(file_.place()));
  file_.publish();
  return printable(file_.place()) + ": " + text + lines_;
}

}  // namespace echofuse::acquire

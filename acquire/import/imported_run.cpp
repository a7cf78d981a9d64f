// SPDX-License-Identifier: MIT
#include "acquire/import/imported_run.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <utility>

#include "acquire/record/columns.hpp"
#include "acquire/record/run_reader.hpp"
#include "acquire/record/written_run.hpp"
#include "acquire/run/new_run.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {

UtcTime modified(const std::string& path) {
  struct stat found {};
  if (::stat(path.c_str(), &found) != 0) return {};
  return std::chrono::seconds(found.st_mtim.tv_sec) +
         std::chrono::nanoseconds(found.st_mtim.tv_nsec);
}

void record_import(Config config, RunOptions options, port::Loop& loop, const NewFile& file) {
  config.policy = {"optional", "optional", "optional"};
  options.out = file.path();
  options.quiet = true;
  record_run(config, options, loop);
  if (interrupted())
    throw Error(ExitCode::interrupted,
                printable(file.place()) + ": interrupted; nothing was written");
}

std::string publish_import(NewFile& file, std::string warnings) {
  const std::string place = printable(file.place());
  record::check_written_run(file.path(), place);
  std::string text, causes;
  bool any = false;
  {
    const record::RunReader run(file.path());
    const record::RunSummary made = run.summary();
    const record::FusedRecord last = run.read(made.last_index);
    text = std::to_string(made.records) + " records";
    for (const Sensor s : all_sensors) {
      const std::string cause = last.sync[s].cause();
      any = any || made.valid[s] > 0;
      if (made.valid[s] > 0)
        text.append(", ").append(name_of(s)).append(" in ").append(std::to_string(made.valid[s]));
      else if (!cause.empty())
        causes.append("; ").append(name_of(s)).append(": ").append(cause);
    }
  }
  if (!any) {
    std::ranges::replace(warnings, '\n', ' ');
    throw Error(ExitCode::failed, place + ": nothing to import: " + printable(text + causes) +
                                      "; no record contains valid data" +
                                      (warnings.empty() ? "" : ";" + warnings));
  }
  file.publish();
  return place + ": " + text;
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

void ImportedRun::put(record::FusedRecord record) {
  check_.assess(record, axes_);
  clock_.at = std::max(clock_.at, record.slot_end);
  clock_.utc_at = std::max(clock_.utc_at, record.slot_utc + (record.slot_end - record.slot_start));
  record::for_each_column([&](const auto& column, std::size_t) {
    batch_bytes_ += as_bytes(record.*column.values).size();
  });
  batch_.push_back(std::move(record));
  if (constexpr std::size_t max_records = 256, max_bytes = 4 << 20;
      batch_.size() == max_records || batch_bytes_ > max_bytes)
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

std::string ImportedRun::finish() {
  flush();
  run_->close_as_one_file("complete");
  return publish_import(file_, lines_) + lines_;
}

}  // namespace echofuse::acquire

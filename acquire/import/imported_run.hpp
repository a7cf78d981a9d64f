// SPDX-License-Identifier: MIT
// Writes runs imported from arrays. Their records get the same verdicts as those of a live run
// (signal_check.hpp). Publishes imported runs of all kinds.
#pragma once
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "acquire/intake/signal_check.hpp"
#include "acquire/record/run_writer.hpp"
#include "acquire/run/daemon.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/util/new_file.hpp"

namespace echofuse::acquire {

// Time at which the first slot begins.
struct RunStart {
  UtcTime utc{};
  std::string doubt;  // reason why the start time is uncertain; empty if --began is given
};

UtcTime modified(const std::string& path);

// Records an import in virtual time to the unpublished `file`. No sensor is required. Throws the
// errors of record_run(), also if the user interrupts the program.
void record_import(Config config, RunOptions options, port::Loop& loop, const NewFile& file);

// Publishes a complete run file. Returns a line about its contents. If no record has a valid
// sensor, publishes nothing and throws Error(failed); the message ends with `warnings`, one per
// line.
std::string publish_import(NewFile& file, std::string warnings = {});

// Threading: an ImportedRun may be used by only one thread at a time.
class ImportedRun {
 public:
  using MakeWriter =
      std::function<std::unique_ptr<record::RunWriter>(const std::string& path, const Clock&)>;
  // Throws Error(failed) if `out` exists, or Error(disk) if it cannot be written.
  ImportedRun(const std::string& out, const RunStart& began, const SignalCheck& check,
              const MakeWriter& make);

  void put_axes(const std::vector<Axis>& axes);
  void put(record::FusedRecord record);
  // Adds a warning to the run and to the lines returned by finish().
  void doubt(const std::string& text);
  UtcTime utc_of(HostTime t) const { return clock_.began + t; }
  // Returns the result of publish_import(), then the warnings, one per line.
  std::string finish();

 private:
  // Clock that returns the time of the recording, which is stored in the run's metadata.
  struct RecordingClock final : Clock {
    HostTime now() const override { return at; }
    UtcTime utc() const override { return utc_at; }
    UtcTime began{}, utc_at{};
    HostTime at{};
  };
  void flush();

  NewFile file_;
  RecordingClock clock_;
  SignalCheck check_;
  std::unique_ptr<record::RunWriter> run_;
  std::vector<Axis> axes_;
  std::vector<record::FusedRecord> batch_;  // records not yet written
  std::size_t batch_bytes_ = 0;
  std::string lines_;
};

}  // namespace echofuse::acquire

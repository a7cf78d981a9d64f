// SPDX-License-Identifier: MIT
// The run that an import makes. Every import writes its records here, so that each record gets the
// verdicts of a live run (signal_check.hpp).
#pragma once
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "acquire/record/run_file.hpp"
#include "acquire/run/signal_check.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/util/new_file.hpp"

namespace echofuse::acquire {

// Time at which the first slot begins.
struct Beginning {
  UtcTime utc{};
  std::string doubt;  // empty: it was given
};

// Time of the last change of a file.
UtcTime modified(const std::string& path);

// Threading: one thread at a time.
class ImportedRun {
 public:
  using Make =
      std::function<std::unique_ptr<record::RunWriter>(const std::string& path, const Clock&)>;
  // Throws Error: `out` exists (failed) or cannot be written (disk).
  ImportedRun(const std::string& out, const Beginning& began, const SignalCheck& check,
              const Make& make);

  record::RunWriter& writer() { return *run_; }
  void put_axes(const std::vector<Axis>& axes);
  void put(record::FusedRecord record, const SignalCheck::Ends& ends = {});
  // A warning of the run and a line of finish().
  void doubt(const std::string& text);
  void put_counters(Sensor sensor, const std::vector<Counter>& counters);
  const TagCounts& tags() const { return tags_; }
  std::int64_t valid(Sensor s) const { return valid_[s]; }
  const std::string& verdict(Sensor s) const { return verdict_[s]; }  // last one without data
  UtcTime utc_of(HostTime t) const { return clock_.began + t; }
  // Publishes the run and returns what is in it, then the doubts, a line each. Throws Error(failed)
  // if no record has a valid sensor; then nothing is written.
  std::string finish();

 private:
  // The time of the recording, for the file that is made of it.
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
  std::vector<record::Counted> counted_;
  PerSensor<std::int64_t> valid_{};
  TagCounts tags_;
  PerSensor<std::string> verdict_{};
  std::vector<record::FusedRecord> batch_;  // not yet written
  std::size_t batch_bytes_ = 0;
  std::string lines_;
};

}  // namespace echofuse::acquire

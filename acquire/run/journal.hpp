// SPDX-License-Identifier: MIT
// What a run file holds beside its records: devices, axes, clock anchors, policies, calibration,
// late samples and counters.
#pragma once
#include <chrono>
#include <cstdint>
#include <deque>
#include <set>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/run/run_log.hpp"
#include "acquire/run/window.hpp"
#include "acquire/run/writer.hpp"

namespace echofuse::acquire {

// Threading: the loop's thread only; the writer's thread does the work.
class Journal {
 public:
  // Both must outlive this. `begun_axes`: those that the file of a resumed run has. Puts an anchor.
  Journal(Writer& writer, const Clock& clock, const std::vector<Axis>& begun_axes);

  // Once, of a run that begins; a resumed run keeps the calibration that it was begun with.
  void put_config(const Config& config, bool resumed);
  void put_device(const DeviceInfo& device);     // one row a device, not one a reconnection
  void put_axes(const std::vector<Axis>& axes);  // those that the file does not have
  // A new one once a minute, and at once, with a warning, when the machine's clock was set or the
  // machine slept.
  void refresh_anchor(RunLog& log);
  // For slots in their order. Those that began before the clock was set keep the time of before.
  UtcTime utc_of(HostTime slot_start);
  // `first`: the record of slot 0.
  void put_late(std::int64_t first, record::LateCounts late);
  // At the run's end: the drivers' counters and the samples that are in no record, all of them or
  // none.
  void put_counters(PerSensor<std::vector<Counter>> counters, const UnassignedSamples& unassigned);

 private:
  struct Anchor {
    HostTime mono{};
    std::chrono::nanoseconds utc_offset{};  // UTC minus monotonic time
    HostTime from{};                        // the first slot start that it stands for
  };
  Anchor put_anchor();

  Writer& writer_;
  const Clock& clock_;
  std::set<std::string> axes_;         // by name
  PerSensor<std::string> identities_;  // of the devices written
  std::deque<Anchor> anchors_;  // the last one, and before it those that open slots began with
};

// A warning for each kind of unassigned samples that matters.
void report_unassigned(RunLog& log, const UnassignedSamples& unassigned);

}  // namespace echofuse::acquire

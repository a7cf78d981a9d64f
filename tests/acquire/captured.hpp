// SPDX-License-Identifier: MIT
// Slot of the doctor command with artificial samples.
#pragma once
#include "../fixtures/record.hpp"
#include "acquire/doctor/doctor.hpp"

namespace echofuse::test {

// Start and centre of the slot of captured().
inline constexpr HostTime doctor_begin = std::chrono::seconds(10);
inline constexpr HostTime doctor_middle = doctor_begin + std::chrono::seconds(1);

// Returns a slot of doctor. `send` sends samples to the capture.
template <class Send>
acquire::Capture captured(const acquire::Config& config, const DeviceInfo& device,
                          const Send& send) {
  const acquire::SensorClocks clocks;
  acquire::Capture capture(config);
  send(capture);  // samples received before the slot begins are not counted
  capture.begin(doctor_begin, clocks);
  capture.on_state(device.sensor, DeviceState::streaming, device);
  send(capture);
  capture.end();
  return capture;
}

// Checks the grade of a finding, and words of its text or advice.
inline void check_finding(const acquire::Finding& finding, acquire::Grade grade,
                          const std::string& words = {}) {
  CAPTURE(finding.found, finding.advice);
  CHECK(finding.grade == grade);
  CHECK_THAT(finding.found + "; " + finding.advice, Catch::Contains(words));
}

}  // namespace echofuse::test

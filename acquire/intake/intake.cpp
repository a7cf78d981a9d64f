// SPDX-License-Identifier: MIT
#include "acquire/intake/intake.hpp"

namespace echofuse::acquire {
namespace {

// Start of slot 0 until begin(). The difference to any time of a sample fits into 64 bits.
constexpr HostTime never = HostTime::max() / 2;

SignalLimits limits_of(const Config& config, double window_s) {
  SignalLimits limits = config.signal;
  limits.spd_clicks *= window_s / config.window_s;
  return limits;
}

}  // namespace

Intake::Intake(const Config& config, double window_s, const SensorClocks& clocks)
    : slots({never, from_seconds(window_s)}, config.histogram, clocks, config.configured(),
            config.required()),
      check_(limits_of(config, window_s), window_s, config.nominal_hz(), config.map.far_m) {}

record::FusedRecord Intake::close(const DueSlot& due) {
  record::FusedRecord record = slots.close(due);
  check_.assess(record, slots.axes(), ends_);
  return record;
}

}  // namespace echofuse::acquire

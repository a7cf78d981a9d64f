// SPDX-License-Identifier: MIT
#include "drivers/radar/ramp.hpp"

#include <cmath>
#include <sstream>

#include "drivers/core/axis.hpp"

namespace echofuse::radar {
namespace {

// Sources: see ramp.hpp.
constexpr double band_start_ghz = 60, band_end_ghz = 64;
constexpr double start_step_ghz = 2.7 / (1 << 26);
constexpr double slope_step_mhz_us = 2.7e3 * 900 / (1 << 26);
constexpr double time_step_us = 0.01;

// Rounds towards 0 to a multiple of `step`. The margin keeps exact multiples unchanged despite the
// rounding error of the quotient.
double truncated(double value, double step) { return std::trunc(value / step + 1e-6) * step; }

}  // namespace

std::string digits(double value, double unit) {
  std::ostringstream text;
  text.precision(9);
  text << std::round(value / unit) * unit;
  return text.str();
}

Ramp Ramp::in_steps() const {
  return {truncated(start_ghz, start_step_ghz),
          truncated(idle_us, time_step_us),
          truncated(adc_start_us, time_step_us),
          truncated(end_us, time_step_us),
          truncated(slope_mhz_us, slope_step_mhz_us),
          samples,
          rate_ksps};
}

double Ramp::sampled_until_us() const { return adc_start_us + 1e3 * samples / rate_ksps; }

double Ramp::carrier_hz() const {
  return 1e9 * start_ghz + 1e6 * slope_mhz_us * (adc_start_us + sampled_until_us()) / 2;
}

double Ramp::range_step_m(double points) const {
  const double slope_hz_s = 1e12 * in_steps().slope_mhz_us;
  return speed_of_light_m_s * 1e3 * rate_ksps / (2 * slope_hz_s * points);
}

std::vector<std::string> refusals_of(const Ramp& ramp) {
  std::vector<std::string> out;
  const Ramp r = ramp.in_steps();
  const double end_ghz = r.start_ghz + 1e-3 * r.slope_mhz_us * r.end_us;
  // Tolerance for TI's tool, which rounds the end of a full sweep to the time step: 66.67 us at 60
  // MHz/us.
  const double rounding_ghz = 1e-3 * r.slope_mhz_us * time_step_us / 2;
  constexpr double unit_ghz = 1e-4;
  if (r.start_ghz < band_start_ghz - 2 * start_step_ghz || end_ghz > band_end_ghz + rounding_ghz)
    out.push_back("sweeps " + digits(r.start_ghz, unit_ghz) + " to " + digits(end_ghz, unit_ghz) +
                  " GHz (limits 60 to 64 GHz)" +
                  (r.start_ghz > 75 ? "; is the cfg for xWR14xx, 16xx or 18xx?" : ""));
  if (r.sampled_until_us() > r.end_us + 1e-6)
    out.push_back("samples from " + digits(r.adc_start_us) + " to " + digits(r.sampled_until_us()) +
                  " us, but the ramp ends at " + digits(r.end_us) + " us");
  return out;
}

}  // namespace echofuse::radar

// SPDX-License-Identifier: MIT
#include "recon/data/pile_up.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "acquire/measurement/detector.hpp"

namespace echofuse::recon {

PileUp::PileUp(const record::RunInfo& info, const Axis& spd) {
  const auto detector = record::detector_of(info.meta);
  constexpr double max_window_s = 1e6;
  if (!detector || spd.unit != "ps" || !(info.window_s > 0 && info.window_s <= max_window_s))
    return;
  *this = PileUp(detector->dead_time_ps, info.window_s, spd.step);
}

double PileUp::correct(std::span<float> counts, double pulses) const {
  if (!known() || !(pulses > 0)) return 1;
  // before[i]: number of clicks before the left edge of bin i.
  std::vector<double> before(counts.size() + 1);
  for (std::size_t i = 0; i < counts.size(); ++i) before[i + 1] = before[i] + double{counts[i]};
  const double all = before.back(), bins = static_cast<double>(counts.size());
  // Returns the number of clicks before the position `at`, which is given in bins.
  const auto up_to = [&](double at) {
    const double x = std::clamp(at, 0.0, bins);
    const auto i = std::min(static_cast<std::size_t>(x), counts.size() - 1);
    return before[i] + (x - static_cast<double>(i)) * (before[i + 1] - before[i]);
  };
  const double period = window_ps_ / pulses / bin_width_ps_, dead = dead_time_ps_ / bin_width_ps_;
  const double whole = std::isinf(dead) ? 0 : std::floor(dead / period);
  const double rest = dead - whole * period;
  double minimum = 1;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const double middle = static_cast<double>(i) + 0.5, since = middle - rest;
    // Number of pulses for which the detector is dead in bin i. It is the sum of the clicks within
    // the dead time before the bin, after the same or the previous pulse, plus all clicks of the
    // `whole` periods that the dead time covers.
    double blocked = before[i] - std::min(up_to(since), before[i]) + whole * all;
    if (!std::isinf(dead)) blocked += all - up_to(since + period);
    const auto found = double{counts[i]};
    const double ready = std::max(pulses - blocked, found + 0.5);
    counts[i] = static_cast<float>(-pulses * std::log1p(-found / ready));
    minimum = std::min(minimum, (pulses - blocked) / pulses);
  }
  return minimum;
}

}  // namespace echofuse::recon

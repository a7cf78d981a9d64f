// SPDX-License-Identifier: MIT
#include "recon/trust/record_numbers.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "drivers/util/format.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

using enum RunNumber::Kind;
using M = const RecordValues&;

double background_of(std::vector<float> counts) {
  const double all = std::accumulate(counts.begin(), counts.end(), 0.0);
  return double{quantile(counts, 0.5)} * static_cast<double>(counts.size()) / std::max(all, 1.);
}

// Returns the fraction of the power before half the range of the peak. `first`: bin of power[0].
double power_before(std::span<const float> power, std::size_t first) {
  const auto peak = static_cast<std::size_t>(std::ranges::max_element(power) - power.begin());
  double before = 0, all = 1e-12;
  for (std::size_t i = 0; i < power.size(); ++i) {
    const double v = std::max(double{power[i]}, 0.);
    all += v, before += 2 * (first + i) < first + peak ? v : 0;
  }
  return before / all;
}

std::string range_advice(double difference_m, double error_m) {
  return format(
      "radar ranges are %.1f +- %.1f cm too %s, or people are farther to the %s or reflect "
      "differently than in training; if the radar is the cause, use --range-offset %.3f and "
      "calibrate",
      100 * std::abs(difference_m), 100 * error_m, difference_m > 0 ? "long" : "short",
      difference_m > 0 ? "right" : "left", difference_m);
}

constexpr RecordNumber flag(const char* reason, double (*of)(M), const char* advice = "",
                            const char* unit = nullptr) {
  return {reason, of, {}, advice, unit};
}

}  // namespace

// The widening was fitted to 80 runs of 300 records, made by the digital twin with random bodies,
// reflectivities, responses and noise (2026-11-29; recon/RESULTS.md).
const std::array<RecordNumber, record_number_count> record_numbers = {
    {{"histogram spread", [](M m) { return std::log(m.histogram.deviation); }, {ratio, 0.02}},
     {"histogram skewness", [](M m) { return m.histogram.skewness; }, {number, 0.05, 1}},
     {"background fraction of the clicks", [](M m) { return m.background; }, {number, 0.01}},
     {"range", [](M m) { return m.range_m; }, {length, 0.01}},
     {"radar profile width", [](M m) { return std::log(m.profile.deviation); }, {ratio, 0.02, 1.5}},
     {"radar skewness", [](M m) { return m.profile.skewness; }, {number, 0.05, 2.5}},
     {"radar peak over noise", [](M m) { return std::log(m.peak_to_noise + 1); }, {ratio, 0.02}},
     {"radar power before the body", [](M m) { return m.power_before; }, {number, 0.01}},
     {"radar range", [](M m) { return m.displacement_m; }, {length, 0.005, 5.5, range_advice}},
     flag("empty", [](M m) { return m.empty; }),
     flag(
         "saturated", [](M m) { return m.clicks_per_pulse; },
         "specify the dead time of the detector, or attenuate the light",
         " clicks per laser pulse"),
     flag(
         "outside the training records' distances", [](M m) { return m.range_m; },
         "add training records at these distances, or adapt the model if the room differs", " m"),
     flag("unusual histogram", [](M m) { return m.distances.log_q[0]; }),
     flag("unusual radar profile", [](M m) { return m.distances.log_q[1]; }),
     flag("unusual samples of the radar's antennas", [](M m) { return m.distances.log_q[2]; }),
     flag("unusual samples of the radar's antennas", [](M m) { return m.distances.log_q[3]; }),
     flag("unusual range", [](M m) { return m.distances.log_q[4]; }),
     flag("unusual radar profile", [](M m) { return m.distances.log_q[5]; }),
     flag("unusual values", [](M m) { return m.distances.log_t2; }),
     flag(
         "two bodies, or one unlike the training records'", [](M m) { return m.two_bodies; },
         "record one person at a time")}};

Matrix record_numbers_of(const Alignment& alignment, const Dataset& data, const Matrix& views,
                         const Rows& rows, Inputs inputs) {
  const bool has_spd = inputs != Inputs::radar, has_radar = inputs != Inputs::spd;
  Matrix out(0, run_numbers);
  for (const std::size_t row : rows) {
    const std::span<const float> view = views.row(row);
    if (has_spd && !(view.size() > 0 && shows_body(view))) continue;
    RecordValues m;
    if (has_spd) {
      m.histogram =
          moments_of(alignment.columns(view).histogram, [](double v) { return std::max(v, 0.); });
      m.background = background_of(counts_of(data, row)), m.range_m = double{view.back()};
    }
    if (has_radar) {
      const auto power = beyond_leakage(data.radar(), row);
      // Squares give less weight to noise and side lobes.
      m.profile = moments_of(view.empty() ? power : alignment.columns(view).profile,
                             [](double v) { return v * v; });
      m.peak_to_noise = double{peak_to_noise(power)};
      m.power_before = power_before(power, data.radar().row(row).size() - power.size());
    }
    if (has_spd && has_radar) m.displacement_m = alignment.displacement_m(view);
    std::vector<float> one;
    for (std::size_t k = 0; k < run_numbers; ++k)
      one.push_back(static_cast<float>(record_numbers[k].of(m)));
    out.add_row(one);
  }
  return out;
}

}  // namespace echofuse::recon

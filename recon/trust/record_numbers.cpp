// SPDX-License-Identifier: MIT
#include "recon/trust/record_numbers.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "acquire/measurement/radar_leakage.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

using Kind = RecordNumber::Kind;

struct Moments {
  double deviation, skewness;  // standard deviation in points, and skewness
};

Moments moments_of(const std::vector<double>& weights) {
  double sum = 1e-12, first = 0;
  for (std::size_t i = 0; i < weights.size(); ++i)
    sum += weights[i], first += weights[i] * static_cast<double>(i);
  const double centre = first / sum;
  double second = 0, third = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const double off = static_cast<double>(i) - centre;
    second += weights[i] * off * off, third += weights[i] * off * off * off;
  }
  const double deviation = std::sqrt(second / sum + 1e-6);
  return {deviation, third / sum / std::pow(deviation, 3)};
}

std::array<double, 4> numbers_of_spd(std::span<const float> histogram,
                                     std::span<const float> counts, double range_m) {
  std::vector<double> clicks(histogram.begin(), histogram.end());
  for (double& v : clicks) v = std::max(v, 0.);
  const Moments m = moments_of(clicks);
  std::vector<float> sorted(counts.begin(), counts.end());
  const double background = double{quantile(sorted, 0.5)} * static_cast<double>(counts.size());
  const double all = std::accumulate(counts.begin(), counts.end(), 0.0);
  return {std::log(m.deviation), m.skewness, background / std::max(all, 1.), range_m};
}

// Returns the four numbers that describe the radar data. `body`: profile around the body, or the
// whole profile if the SPD is missing. `power`: profile beyond the leakage, from bin `first`.
std::array<double, 4> numbers_of_radar(std::span<const float> body, std::span<const float> power,
                                       std::size_t first) {
  std::vector<double> squares(body.begin(), body.end());
  for (double& v : squares) v *= v;  // squares give less weight to noise and side lobes
  const Moments m = moments_of(squares);
  const auto peak =
      static_cast<std::size_t>(std::max_element(power.begin(), power.end()) - power.begin());
  double before = 0, all = 1e-12;
  for (std::size_t i = 0; i < power.size(); ++i) {
    const double v = std::max(double{power[i]}, 0.);
    all += v, before += 2 * (first + i) < first + peak ? v : 0;
  }
  return {std::log(m.deviation), m.skewness, std::log(double{peak_to_noise(power)} + 1),
          before / all};
}

}  // namespace

// The widening was fitted to 80 runs of 300 records, made by the digital twin with random bodies,
// reflectivities, responses and noise (2026-11-29; recon/RESULTS.md).
const std::array<RecordNumber, record_number_count> record_numbers = {
    {{"histogram spread", Kind::ratio, 0.02},
     {"histogram skewness", Kind::number, 0.05, 1},
     {"background fraction of the clicks", Kind::number, 0.01},
     {"range", Kind::length, 0.01},
     {"radar profile width", Kind::ratio, 0.02, 1.5},
     {"radar skewness", Kind::number, 0.05, 2.5},
     {"radar peak over noise", Kind::ratio, 0.02},
     {"radar power before the body", Kind::number, 0.01},
     {"radar range", Kind::length, 0.005, 5.5}}};

float peak_to_noise(std::span<const float> power) {
  std::vector<double> sorted(power.begin(), power.end());
  std::sort(sorted.begin(), sorted.end());
  const std::span weaker(sorted.data(), sorted.size() / 2 + 1);
  return static_cast<float>((sorted.back() - mean_of(weaker)) /
                            std::max(standard_deviation(weaker), 1e-12));
}

std::span<const float> beyond_leakage(const Column& profiles, std::size_t row) {
  const auto power = profiles.row(row);
  const std::size_t leakage = record::leakage_bins(profiles.axis);
  return power.size() > leakage + 2 ? power.subspan(leakage) : power;
}

Matrix record_numbers_of(const Alignment& alignment, const Dataset& data, const Matrix& views,
                         const Rows& rows, Inputs inputs) {
  Matrix out(0, record_number_count);
  for (const std::size_t row : rows) {
    const std::span<const float> view = views.row(row);
    if (inputs != Inputs::radar && !(view.size() > 0 && shows_body(view))) continue;
    std::vector<float> one(record_number_count, NAN);
    if (inputs != Inputs::radar)
      std::ranges::copy(numbers_of_spd(alignment.columns(view).histogram, counts_of(data, row),
                                       double{view.back()}),
                        one.begin());
    if (inputs != Inputs::spd) {
      const auto power = beyond_leakage(data.radar(), row);
      const auto body = view.empty() ? power : alignment.columns(view).profile;
      std::ranges::copy(numbers_of_radar(body, power, data.radar().row(row).size() - power.size()),
                        one.begin() + 4);
    }
    if (both_sensors(inputs))
      one[radar_range_number] = static_cast<float>(alignment.displacement_m(view));
    out.add_row(one);
  }
  return out;
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include "recon/trust/record_numbers.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

using Kind = RecordNumber::Kind;

constexpr RecordNumber of_spd[] = {{"histogram spread", Kind::ratio, 0.02},
                                   {"histogram skewness", Kind::number, 0.05},
                                   {"background share of the clicks", Kind::number, 0.01},
                                   {"range", Kind::length, 0.01}};
constexpr RecordNumber of_radar[] = {{"radar profile width", Kind::ratio, 0.02},
                                     {"radar skewness", Kind::number, 0.05},
                                     {"radar peak over noise", Kind::ratio, 0.02},
                                     {"radar power before the body", Kind::number, 0.01}};
constexpr RecordNumber of_both[] = {{"radar range", Kind::length, 0.005, true}};

// These are added before the logarithm: plain noise may make such variation, and it differs with
// the noise.
constexpr std::array<double, power_variations> of_noise = {0.3, 0.3, 0.02};

struct Moments {
  double centre, deviation, skewness;  // in points
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
  return {centre, deviation, third / sum / std::pow(deviation, 3)};
}

void add_of_spd(std::span<const float> histogram, std::span<const float> counts, double range_m,
                std::vector<float>& out) {
  std::vector<double> clicks(histogram.begin(), histogram.end());
  for (double& v : clicks) v = std::max(v, 0.);
  const Moments m = moments_of(clicks);
  std::vector<float> sorted(counts.begin(), counts.end());
  const double level = double{quantile(sorted, 0.5)};
  const double all = std::accumulate(counts.begin(), counts.end(), 0.0);
  for (const double v : {std::log(m.deviation), m.skewness,
                         level * static_cast<double>(counts.size()) / std::max(all, 1.), range_m})
    out.push_back(static_cast<float>(v));
}

// `body` is the profile about the body, or the whole profile.
void add_of_radar(std::span<const float> body, std::span<const float> power,
                  std::vector<float>& out) {
  std::vector<double> squares(body.begin(), body.end());
  for (double& v : squares) v *= v;  // noise and side lobes hardly pull
  const Moments m = moments_of(squares);
  const auto peak =
      static_cast<std::size_t>(std::max_element(power.begin(), power.end()) - power.begin());
  double before = 0, all = 1e-12;
  for (std::size_t i = 0; i < power.size(); ++i) {
    const double v = std::max(double{power[i]}, 0.);
    all += v, before += 2 * i < peak ? v : 0;
  }
  for (const double v : {std::log(m.deviation), m.skewness,
                         std::log(double{peak_to_noise(power)} + 1), before / all})
    out.push_back(static_cast<float>(v));
}

}  // namespace

float peak_to_noise(std::span<const float> power) {
  std::vector<float> sorted(power.begin(), power.end());
  std::sort(sorted.begin(), sorted.end());
  const std::size_t half = sorted.size() / 2;
  double mean = 0, square = 0;
  for (std::size_t i = 0; i <= half; ++i) mean += double{sorted[i]} / double(half + 1);
  for (std::size_t i = 0; i <= half; ++i)
    square += std::pow(double{sorted[i]} - mean, 2) / double(half + 1);
  return static_cast<float>((double{sorted.back()} - mean) / std::max(std::sqrt(square), 1e-12));
}

const std::array<RecordNumber, power_variations> power_variation_numbers = {
    {{"radar power from frame to frame", Kind::ratio, 0.08},
     {"radar power from carrier to carrier", Kind::ratio, 0.08},
     {"radar power within 150 ms", Kind::ratio, 0.08}}};

std::array<double, power_variations> log_power_variations(
    const std::optional<record::Speckle>& found) {
  std::array<double, power_variations> out;
  out.fill(std::numeric_limits<double>::quiet_NaN());
  if (!found) return out;
  const std::array<std::optional<double>, power_variations> values = {
      found->over_frames, found->over_carriers, found->over_150_ms};
  for (std::size_t k = 0; k < out.size(); ++k)
    if (values[k]) out[k] = std::log(*values[k] + of_noise[k]);
  return out;
}

std::vector<RecordNumber> record_numbers(Inputs inputs) {
  std::vector<RecordNumber> out;
  const auto add = [&](const auto& some) {
    for (const RecordNumber& n : some) out.push_back(n);
  };
  if (inputs != Inputs::radar) add(of_spd);
  if (inputs != Inputs::spd) add(of_radar);
  if (both_sensors(inputs)) add(of_both);
  if (inputs != Inputs::spd) add(power_variation_numbers);
  return out;
}

Matrix record_numbers_of(const Alignment& alignment, const Dataset& data, const Matrix& views,
                         const Rows& rows, Inputs inputs) {
  Matrix out(0, record_numbers(inputs).size());
  for (const std::size_t row : rows) {
    std::span<const float> view;
    std::vector<float> one;
    if (inputs != Inputs::radar) {
      view = views.row(row);
      if (view.empty() || !shows_body(view)) continue;
      add_of_spd(alignment.columns(view).histogram, data.spd.row(row), double{view.back()}, one);
    }
    if (inputs != Inputs::spd)
      add_of_radar(view.empty() ? data.radar.row(row) : alignment.columns(view).profile,
                   data.radar.row(row), one);
    if (both_sensors(inputs)) one.push_back(static_cast<float>(alignment.displacement_m(view)));
    if (inputs != Inputs::spd)
      for (const double v : log_power_variations(data.speckle[row]))
        one.push_back(static_cast<float>(v));
    out.add_row(one);
  }
  return out;
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include "recon/data/response_conversion.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>

#include "recon/data/lags.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr double reach_cells = 3;
constexpr std::ptrdiff_t most_reach = 48;  // maximum half-length of the filter, in points
// Limit of the ratio between the response width of a run and that of the model. If the ratio is
// smaller, a model trained for any response uses the run without conversion. In tests with a
// digital twin, the reference was the response of a Blackman window. At a ratio of .67, the IoU was
// .49 without conversion and .45 with conversion. At a ratio of .8, the IoU was .44 without
// conversion and .45 with conversion.
constexpr double much_narrower = 0.75;
// Number of points per range step at which the filtered and the wanted response are compared.
constexpr int parts = 8;
// Noise assumed by the Wiener filter: the sum of the squared noise over eight points, relative to
// the squared peak of the response.
constexpr double noise_to_signal = 1e-3;

// Convolves each of the `stride` interleaved columns of a row with the weights.
void filter(std::span<float> row, std::size_t stride, const std::vector<double>& weights) {
  const auto reach = std::ssize(weights) / 2,
             count = std::ssize(row) / static_cast<std::ptrdiff_t>(stride);
  std::vector<float> before(static_cast<std::size_t>(count));
  for (std::size_t k = 0; k < stride; ++k) {
    for (std::size_t i = 0; i < before.size(); ++i) before[i] = row[i * stride + k];
    for (std::ptrdiff_t i = 0; i < count; ++i) {
      double sum = 0;
      const auto from = std::max<std::ptrdiff_t>(-reach, -i), to = std::min(reach, count - 1 - i);
      for (auto j = from; j <= to; ++j)
        sum += weights[static_cast<std::size_t>(j + reach)] *
               double{before[static_cast<std::size_t>(i + j)]};
      row[static_cast<std::size_t>(i) * stride + k] = static_cast<float>(sum);
    }
  }
}

double sinc(double u) {
  const double x = std::numbers::pi * u;
  return std::abs(u) < 1e-9 ? 1 : std::sin(x) / x;
}

// Returns the response of the window cos^(2 order). Apart from a constant factor, this window is
// the sum over k of C(2 order, order + k) cos(2 pi k t).
record::RadarResponse response_of_cosine(int order, double cell_m) {
  constexpr int taps = 24;
  record::RadarResponse out{cell_m, {}};
  for (int tap = 0; tap < taps; ++tap) {
    const double u = double{1} / record::RadarResponse::taps_a_cell * tap;
    double amplitude = sinc(u), share = 1;
    for (int k = 1; k <= order; ++k) {
      share *= static_cast<double>(order - k + 1) / (order + k);
      amplitude += share * (sinc(u - k) + sinc(u + k));
    }
    out.taps.push_back(amplitude * amplitude);
  }
  return out;
}

// Returns the standard deviation of the noise in columns `first`, `first + stride`, and so on: the
// lower quartile of the standard deviations of these columns. The standard deviation of a column is
// estimated as its median minus its 15.87 % quantile, because values above the median contain
// echoes.
float quiet_deviation(const Matrix& table, const Rows& rows, std::size_t first,
                      std::size_t stride) {
  constexpr double one_deviation_below = 0.1587;
  std::vector<float> deviations;
  for (std::size_t c = first; c < table.cols; c += stride) {
    std::vector<float> values;
    for (const std::size_t row : rows) values.push_back(table.row(row)[c]);
    const float middle = quantile(values, 0.5);
    deviations.push_back(middle - quantile(values, one_deviation_below));
  }
  return deviations.empty() ? 0 : quantile(deviations, 0.25);
}

// Returns the number of lag values per range bin; 0 if there are no lags.
std::size_t lags_of(const Dataset& data) {
  return data.array_axis.count > 0 ? lag_values(longest_lag(data.array_axis)) : 0;
}

double noise_factor_of(const std::vector<double>& weights) {
  return std::sqrt(std::inner_product(weights.begin(), weights.end(), weights.begin(), 0.));
}

}  // namespace

std::vector<double> response_filter(const record::RadarResponse& own,
                                    const record::RadarResponse& wanted, double step_m) {
  using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
  const double cell_m = std::max(own.cell_m, wanted.cell_m);
  const auto reach = std::clamp<std::ptrdiff_t>(
      static_cast<std::ptrdiff_t>(std::ceil(reach_cells * cell_m / step_m)), 1, most_reach);
  const Index count = 2 * reach + 1, places = 2 * parts * 2 * reach + 1;
  MatrixXd responses(places, count);
  VectorXd target(places);
  for (Index i = 0; i < places; ++i) {
    const double at_m = static_cast<double>(i - places / 2) / parts * step_m;
    target[i] = wanted.power(at_m);
    for (Index j = 0; j < count; ++j)
      responses(i, j) = own.power(at_m - static_cast<double>(j - reach) * step_m);
  }
  const MatrixXd square = responses.transpose() * responses / parts +
                          noise_to_signal * MatrixXd::Identity(count, count);
  const VectorXd out = square.ldlt().solve(responses.transpose() * target / parts);
  return {out.begin(), out.end()};
}

record::RadarResponse widest_response(const Dataset& data) {
  record::RadarResponse out;
  double widest_m = 0;
  for (const Source& source : data.sources) {
    if (!source.radar_response.known()) continue;
    if (const double width_m = source.radar_response.width_m(); width_m > widest_m)
      widest_m = width_m, out = source.radar_response;
  }
  return out;
}

void bring_to_response(Dataset& data, const record::RadarResponse& wanted, bool knows_any) {
  if (!wanted.known() || data.radar_axis.quantity != "power" || data.radar_axis.unit != "m") return;
  for (Source& source : data.sources) {
    if (!source.radar_response.known() || source.radar_response == wanted) continue;
    if (knows_any && source.radar_response.width_m() < much_narrower * wanted.width_m()) continue;
    const auto weights = response_filter(source.radar_response, wanted, data.radar_axis.step);
    const std::size_t lags = lags_of(data);
    for_each_part(source.count, [&](std::size_t i) {
      const std::size_t row = source.first + i;
      if (!all_same(data.radar.row(row))) filter(data.radar.row(row), 1, weights);
      if (lags > 0) filter(data.array.row(row), lags, weights);
    });
    source.times_wider = source.radar_response.width_m() / wanted.width_m();
    source.noise_factor = noise_factor_of(weights);
    source.radar_response = wanted;
  }
}

std::vector<record::RadarResponse> wider_responses(const record::RadarResponse& than) {
  constexpr double least = 1.05;
  std::vector<record::RadarResponse> out;
  for (int order = 1; than.known() && order <= 4; ++order)
    if (auto response = response_of_cosine(order, than.cell_m);
        response.width_m() > least * than.width_m())
      out.push_back(std::move(response));
  return out;
}

RadarNoise::RadarNoise(const Dataset& data, const Rows& rows)
    : power(quiet_deviation(data.radar, rows, 0, 1)) {
  const std::size_t count = lags_of(data);
  for (std::size_t k = 0; k < count; ++k)
    lags.push_back(quiet_deviation(data.array, rows, k, count));
}

void imitate_brought(Dataset& data, const record::RadarResponse& own,
                     const record::RadarResponse& wider, const RadarNoise& noise, Rng& rng) {
  const double step_m = data.radar_axis.step;
  const auto widen = response_filter(own, wider, step_m),
             back = response_filter(wider, own, step_m);
  std::normal_distribution<float> normal;
  const auto bring = [&](std::span<float> row, std::size_t stride, auto deviation_of) {
    if (row.empty() || all_same(row)) return;
    filter(row, stride, widen);
    for (std::size_t i = 0; i < row.size(); ++i) row[i] += deviation_of(i) * normal(rng);
    filter(row, stride, back);
  };
  for (std::size_t row = 0; row < data.size(); ++row) {
    bring(data.radar.row(row), 1, [&](std::size_t) { return noise.power; });
    if (const std::size_t count = noise.lags.size(); count > 0)
      bring(data.array.row(row), count, [&](std::size_t i) { return noise.lags[i % count]; });
  }
}

}  // namespace echofuse::recon

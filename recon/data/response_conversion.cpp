// SPDX-License-Identifier: MIT
#include "recon/data/response_conversion.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>

#include "recon/numbers/parallel.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

// Half-length of the filter: at least 3 range cells, and the distance from the peak at which the
// power of either response last exceeds 1 % of the peak. A phase ripple of the sweep causes such
// distant echoes. A longer filter for all responses would only amplify noise (recon/RESULTS.md).
// `min_power` does not include the standard error of the taps, which is that of the flanks: with
// twice an error of .01 to .04, the largest error of a converted ripple of 4 rad rises from .5 to
// .8 % of the peak, and that of windows changes by at most 2 % (2026-11-30).
constexpr double min_reach_cells = 3, min_power = 0.01;
constexpr std::ptrdiff_t max_reach = 48;  // points
// Limit of the ratio between the response width of a run and that of the model. If the ratio is
// smaller, a model trained for any response uses the run without conversion. In tests with a
// digital twin, the reference was the response of a Blackman window. At a ratio of .67, the IoU was
// .49 without conversion and .45 with conversion. At a ratio of .8, the IoU was .44 without
// conversion and .45 with conversion.
constexpr double much_narrower = 0.75;
// Number of points per range step at which the filtered and the expected response are compared.
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
float noise_deviation(const Matrix& table, const Rows& rows, std::size_t first,
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

// Calls `change` for each column of the radar that has values.
template <class Data, class Change>
void for_each_of_radar(Data& data, Change change) {
  for (auto& column : data.columns)
    if (column.sensor == Sensor::radar && column.cols > 0) change(column);
}

double extent_m(const record::RadarResponse& response) {
  const auto peak = static_cast<double>(response.peak());
  double taps = 0;
  for (std::size_t i = 0; i < response.taps.size(); ++i)
    if (response.taps[i] > min_power)
      taps = std::max(taps, std::abs(static_cast<double>(i) - peak));
  return taps / record::RadarResponse::taps_a_cell * response.cell_m;
}

double noise_factor_of(const std::vector<double>& weights) {
  return std::sqrt(std::inner_product(weights.begin(), weights.end(), weights.begin(), 0.));
}

}  // namespace

std::vector<double> response_filter(const record::RadarResponse& own,
                                    const record::RadarResponse& expected, double step_m) {
  using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
  const double cell_m = std::max(own.cell_m, expected.cell_m);
  const double reach_m = std::max({min_reach_cells * cell_m, extent_m(own), extent_m(expected)});
  const auto reach = std::clamp<std::ptrdiff_t>(
      static_cast<std::ptrdiff_t>(std::ceil(reach_m / step_m)), 1, max_reach);
  const Index count = 2 * reach + 1, places = 2 * parts * 2 * reach + 1;
  MatrixXd responses(places, count);
  VectorXd target(places);
  for (Index i = 0; i < places; ++i) {
    // Range of the target, relative to the output sample.
    const double at_m = static_cast<double>(i - places / 2) / parts * step_m;
    target[i] = expected.power(-at_m);
    for (Index j = 0; j < count; ++j)
      responses(i, j) = own.power(static_cast<double>(j - reach) * step_m - at_m);
  }
  const MatrixXd square = responses.transpose() * responses / parts +
                          noise_to_signal * MatrixXd::Identity(count, count);
  const VectorXd out = square.ldlt().solve(responses.transpose() * target / parts);
  return {out.begin(), out.end()};
}

ModelResponse::ModelResponse(const Dataset& data, bool any_of_runs) : any(any_of_runs) {
  for (const Source& source : data.sources)
    if (const auto& own = source.response.radar;
        own.known() && (!radar.known() || own.width_m() > radar.width_m()))
      radar = own;
}

void ModelResponse::convert(Dataset& data) const {
  const Axis& axis = data.radar().axis;
  if (!radar.known() || axis.quantity != "power" || axis.unit != "m") return;
  for (Source& source : data.sources) {
    RunResponse& own = source.response;
    if (!own.radar.known() || own.radar == radar) continue;
    if (any && own.radar.width_m() < much_narrower * radar.width_m()) continue;
    const auto weights = response_filter(own.radar, radar, axis.step);
    for_each_of_radar(data, [&](Column& column) {
      for_each_part(source.count, [&](std::size_t i) {
        const auto row = column.row(source.first + i);
        if (!all_same(row)) filter(row, column.axis.values_per_bin(), weights);
      });
    });
    own = {radar, own.radar.width_m() / radar.width_m(), noise_factor_of(weights)};
  }
}

std::string ModelResponse::note(const Dataset& data) const {
  const bool stated = std::ranges::all_of(
      data.sources, [](const Source& run) { return run.response.radar.known(); });
  if (!radar.known() || data.radar().axis.count == 0 || stated) return {};
  return "the run contains no radar response; the response of the training data is assumed";
}

void ModelResponse::archive(Archive archive) {
  archive.count("any", any, 0, 1);
  if (!archive.part("known", radar.known())) return;
  archive.number("cell_m", radar.cell_m, 1e-3, 10);
  archive.values("taps", radar.taps, Archive::any);
  archive.require(
      radar.valid() && std::ranges::all_of(radar.taps, [](double v) { return v >= 0 && v <= 2; }),
      "taps", "expected 3 to 64 powers with a peak of 1");
}

std::vector<record::RadarResponse> wider_responses(const record::RadarResponse& than) {
  constexpr double min_ratio = 1.05;
  std::vector<record::RadarResponse> out;
  for (int order = 1; than.known() && order <= 4; ++order)
    if (auto response = response_of_cosine(order, than.cell_m);
        response.width_m() > min_ratio * than.width_m())
      out.push_back(std::move(response));
  return out;
}

RadarNoise radar_noise(const Dataset& data, const Rows& rows) {
  RadarNoise out;
  for_each_of_radar(data, [&](const Column& column) {
    auto& deviations = out.emplace_back();
    const std::size_t count = column.axis.values_per_bin();
    for (std::size_t k = 0; k < count; ++k)
      deviations.push_back(noise_deviation(column, rows, k, count));
  });
  return out;
}

WiderRadars::WiderRadars(const Dataset& data, const Rows& rows, Inputs inputs) {
  if (inputs == Inputs::spd) return;
  own_ = ModelResponse(data).radar, wider_ = wider_responses(own_);
  if (!wider_.empty()) noise_ = radar_noise(data, rows);
}

Dataset WiderRadars::imitated(std::size_t k, const Dataset& from, const Rows& rows,
                              Rng& rng) const {
  Dataset data = part_of(from, rows);
  const record::RadarResponse &own = own_, &wider = wider_[k];
  const double step_m = data.radar().axis.step;
  const auto widen = response_filter(own, wider, step_m),
             back = response_filter(wider, own, step_m);
  std::normal_distribution<float> normal;
  for (std::size_t row = 0; row < data.size(); ++row) {
    auto deviations = noise_.begin();
    for_each_of_radar(data, [&](Column& column) {
      const auto values = column.row(row);
      const std::vector<float>& deviation = *deviations++;
      if (all_same(values)) return;
      filter(values, deviation.size(), widen);
      for (std::size_t i = 0; i < values.size(); ++i)
        values[i] += deviation[i % deviation.size()] * normal(rng);
      filter(values, deviation.size(), back);
    });
  }
  return data;
}

}  // namespace echofuse::recon

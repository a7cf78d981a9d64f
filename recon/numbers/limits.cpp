// SPDX-License-Identifier: MIT
#include "recon/numbers/limits.hpp"

#include <algorithm>
#include <cmath>

#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {

void Limits::add(double times_wider, const Matrix& held, std::span<const double> rates) {
  times_wider_.push_back(times_wider);
  for (std::size_t c = 0; c < held.cols; ++c) {
    std::vector<float> values;
    for (std::size_t i = 0; i < held.rows; ++i)
      if (const float v = held.row(i)[c]; !std::isnan(v)) values.push_back(v);
    const double median = values.empty() ? 0 : double{quantile(values, 0.5)};
    const double limit = values.empty() ? 1 : upper_limit(std::move(values), rates[c]);
    table_.push_back(median), table_.push_back(std::max(limit, median + 1e-6));
  }
}

std::vector<double> Limits::shares(std::span<const double> numbers, double times_wider) const {
  const std::vector<double> at = interpolated(times_wider_, table_, times_wider);
  std::vector<double> out;
  for (std::size_t c = 0; c < numbers.size(); ++c)
    out.push_back((numbers[c] - at[2 * c]) / (at[2 * c + 1] - at[2 * c]));
  return out;
}

void Limits::archive(Archive archive, std::size_t numbers) {
  std::size_t wider = std::max<std::size_t>(times_wider_.size(), 1) - 1;
  archive.count("brought", wider, 0, 16);
  times_wider_.resize(wider + 1, 1), table_.resize(2 * numbers * (wider + 1));
  for (std::size_t k = 0; k <= wider; ++k) {
    Archive one = k == 0 ? archive : archive.in("brought_" + std::to_string(k - 1));
    const auto at = table_.begin() + static_cast<std::ptrdiff_t>(2 * numbers * k);
    std::vector<double> limits(at, at + static_cast<std::ptrdiff_t>(2 * numbers));
    one.values("limits", limits, 2 * numbers);
    std::ranges::copy(limits, at);
    for (std::size_t c = 0; c < numbers; ++c)
      one.require(limits[2 * c + 1] >= limits[2 * c], "limits",
                  "expected a limit above the median");
    if (k == 0) continue;
    one.number("times_wider", times_wider_[k], 1, 1e3);
    one.require(times_wider_[k] > times_wider_[k - 1], "times_wider",
                "expected ascending values above 1");
  }
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "drivers/chart/chart.hpp"

namespace echofuse::chart {
namespace {

std::vector<double> decades(double first, double last, double length_px) {
  std::vector<double> out;
  const double span = std::log10(last / first);
  const bool fine = (span < 1.7 && length_px > 90) || (span < 2.7 && length_px > 260);
  const auto from = static_cast<int>(std::floor(std::log10(first)));
  const auto to = static_cast<int>(std::ceil(std::log10(last)));
  for (int d = from; d <= to; ++d)
    for (const double factor : {1.0, 2.0, 5.0}) {
      const double value = factor * std::pow(10.0, d);
      const bool within = value >= first * (1 - 1e-9) && value <= last * (1 + 1e-9);
      if (within && (fine || factor == 1)) out.push_back(value);
    }
  if (out.size() < 2 && last > first) return round_ticks(first, last, false, length_px);
  return out;
}

}  // namespace

std::string short_number(double value, double beside) {
  std::array<char, 40> text{};
  const double size = std::max(std::abs(value), value == 0 ? 0 : beside) * (1 + 1e-9);
  const bool mega = size >= 1e6, kilo = !mega && size >= 1e4;
  std::snprintf(text.data(), text.size(), "%.4g%s",
                value / (mega   ? 1e6
                         : kilo ? 1e3
                                : 1),
                mega   ? " M"
                : kilo ? " k"
                       : "");
  return text.data();
}

std::vector<double> round_ticks(double first, double last, bool log, double length_px) {
  if (!(last > first)) return {first};
  if (log) return decades(first, last, length_px);
  const double rough = (last - first) / std::max(2.0, length_px / 58);
  const double power = std::pow(10, std::floor(std::log10(rough)));
  double step = 10 * power;
  for (const double factor : {5.0, 2.0, 1.0})
    if (factor * power >= rough * 0.999) step = factor * power;
  std::vector<double> out;
  for (double k = std::ceil(first / step - 1e-9); k * step <= last + 1e-9 * step; ++k)
    out.push_back(k == 0 ? 0 : k * step);
  return out;
}

}  // namespace echofuse::chart

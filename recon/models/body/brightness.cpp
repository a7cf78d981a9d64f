// SPDX-License-Identifier: MIT
#include "recon/models/body/brightness.hpp"

#include <cmath>
#include <vector>

#include "recon/numbers/matrix_file.hpp"

namespace echofuse::recon {

// Least squares. Records at one range have no slope.
void Brightness::fit(const Matrix& range_and_value) {
  const auto n = static_cast<double>(range_and_value.rows);
  double s = 0, v = 0, ss = 0, sv = 0;
  for (std::size_t i = 0; i < range_and_value.rows; ++i) {
    const double x = std::log(double{range_and_value.row(i)[0]});
    const auto value = double{range_and_value.row(i)[1]};
    s += x / n, v += value / n, ss += x * x / n, sv += x * value / n;
  }
  const double variance = ss - s * s;
  slope_ = variance > 1e-9 ? (sv - s * v) / variance : 0;
  level_ = v - slope_ * s;
}

void Brightness::write(float clicks, float power, float range_m, std::span<float> out) const {
  forget(out);
  if (!(clicks > 0 && power > 0 && range_m > 0)) return;
  const double expected = level_ + slope_ * std::log(double{range_m});
  out[0] = static_cast<float>(std::log(double{power} / double{clicks}) - expected);
  out[1] = 1;
}

void Brightness::strengthen(std::span<float> brightness, double times) {
  if (known(brightness)) brightness[0] += static_cast<float>(std::log(times));
}

void Brightness::save(record::H5File& file) const {
  file.write("alignment/brightness", std::vector<double>{level_, slope_}, {2});
}

void Brightness::load(const record::H5File& file) {
  const auto values = file.read<double>("alignment/brightness", {2});
  require_sound(file, std::isfinite(values[0]) && std::isfinite(values[1]), "alignment/brightness",
                "finite numbers");
  level_ = values[0], slope_ = values[1];
}

}  // namespace echofuse::recon

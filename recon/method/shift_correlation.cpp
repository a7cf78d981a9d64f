// SPDX-License-Identifier: MIT
#include "recon/method/shift_correlation.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "recon/numbers/blas.hpp"

namespace echofuse::recon {
namespace {

constexpr int parts = 4;  // parts of a histogram's bin, whose clicks lie anywhere in it

double power_of(double in_resolutions) {
  const double x = M_PI * in_resolutions;
  const double amplitude = std::abs(x) < 1e-6 ? 1 : std::sin(x) / x;
  return amplitude * amplitude;
}

}  // namespace

ShiftCorrelation::ShiftCorrelation(const Points& histogram, const Points& profile,
                                   double resolution_m, double shift_from_m, double shift_to_m) {
  const auto near = static_cast<std::ptrdiff_t>(std::floor(shift_from_m / profile.step_m));
  const auto far = static_cast<std::ptrdiff_t>(std::ceil(shift_to_m / profile.step_m));
  shifts_ = static_cast<std::size_t>(far - near) + 1;
  blur_ = Matrix(histogram.count, profile.count + shifts_ - 1);
  for (std::size_t i = 0; i < blur_.rows; ++i)
    for (std::size_t g = 0; g < blur_.cols; ++g) {
      const double at_m =
          profile.first_m + (static_cast<double>(g) - static_cast<double>(far)) * profile.step_m;
      const double bin_m = histogram.first_m + static_cast<double>(i) * histogram.step_m;
      double sum = 0;
      for (int k = 0; k < parts; ++k)
        sum +=
            power_of((at_m - bin_m - ((k + 0.5) / parts - 0.5) * histogram.step_m) / resolution_m);
      blur_.row(i)[g] = static_cast<float>(sum / parts);
    }
}

std::size_t ShiftCorrelation::cost() const {
  return blur_.values.size() + (blur_.cols - shifts_ + 1) * shifts_;
}

void ShiftCorrelation::operator()(std::span<const float> histogram, std::span<const float> profile,
                                  std::span<float> out) const {
  std::vector<float> expected(blur_.cols), squares(blur_.cols + 1);
  multiply({1, blur_.cols, histogram.size(), Transpose::no, Transpose::no, 1.f, 1.f},
           histogram.data(), blur_.values.data(), expected.data());
  for (std::size_t g = 0; g < expected.size(); ++g)
    squares[g + 1] = squares[g] + expected[g] * expected[g];
  std::fill(out.begin(), out.end(), 0.f);
  float own = 0;
  for (std::size_t j = 0; j < profile.size(); ++j) {
    own += profile[j] * profile[j];
    for (std::size_t s = 0; s < shifts_; ++s) out[s] += expected[s + j] * profile[j];
  }
  for (std::size_t s = 0; s < shifts_; ++s) {
    const float norm = std::sqrt(own * (squares[s + profile.size()] - squares[s]));
    out[s] = norm > 0 ? out[s] / norm : 0;
  }
}

}  // namespace echofuse::recon

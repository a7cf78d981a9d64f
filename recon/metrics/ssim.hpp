// SPDX-License-Identifier: MIT
// Structural similarity of two depth maps (Wang, Bovik, Sheikh, Simoncelli, IEEE TIP 13, 600, 2004)
// with an 11 x 11 Gaussian window of sigma 1.5, K1 0.01, K2 0.03, population covariance.
#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace echofuse::recon {

inline constexpr std::size_t ssim_border = 5;  // half the window: pixels cropped on each side

// Structural similarity at each pixel whose window lies inside the two size x size maps:
// (size-10)^2 values, row-major. `data_range` is the span of possible values (6 m), not of those
// that occur.
std::vector<double> ssim_map(std::span<const float> a, std::span<const float> b, std::size_t size,
                             double data_range);

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include "recon/metrics/people.hpp"

#include <algorithm>
#include <cmath>

namespace echofuse::recon {
namespace {

constexpr int most_passes = 50;

std::uint8_t nearer(const std::array<TwoPeople::Middle, 2>& middle, double x_m, double z_m) {
  const auto off = [&](const TwoPeople::Middle& m) { return std::hypot(m.x_m - x_m, m.z_m - z_m); };
  return off(middle[1]) < off(middle[0]) ? 2 : 1;
}

}  // namespace

std::optional<TwoPeople> find_people(std::span<const float> truth, const Scene& scene) {
  const Axis x = scene.grid.x();
  std::vector<std::size_t> pixels;
  for (std::size_t p = 0; p < truth.size(); ++p)
    if (true_foreground(truth[p], scene.background[p])) pixels.push_back(p);
  const auto at = [&](std::size_t p) {
    const auto z = double{truth[p]};
    return TwoPeople::Middle{x.at(static_cast<double>(p % scene.grid.size)) * z, z};
  };
  const auto [left, right] = std::minmax_element(
      pixels.begin(), pixels.end(), [&](auto a, auto b) { return at(a).x_m < at(b).x_m; });
  if (pixels.empty() || !(at(*left).x_m < at(*right).x_m)) return {};
  TwoPeople out{{at(*left), at(*right)}, std::vector<std::uint8_t>(truth.size())};
  for (int pass = 0; pass < most_passes; ++pass) {
    std::array<TwoPeople::Middle, 2> sum{};
    std::array<double, 2> count{};
    bool changed = false;
    for (const std::size_t p : pixels) {
      const auto [x_m, z_m] = at(p);
      const std::uint8_t who = nearer(out.middle, x_m, z_m);
      changed |= who != out.person[p];
      out.person[p] = who;
      sum[who - 1u].x_m += x_m, sum[who - 1u].z_m += z_m, ++count[who - 1u];
    }
    if (!changed) break;
    for (std::size_t k = 0; k < 2; ++k)
      if (count[k] > 0) out.middle[k] = {sum[k].x_m / count[k], sum[k].z_m / count[k]};
  }
  return out;
}

double iou_per_person(std::span<const float> prediction, const TwoPeople& people,
                      const Scene& scene) {
  const Axis x = scene.grid.x();
  const auto share = foreground_share(prediction, scene);
  std::array<double, 2> both{}, any{};
  for (std::size_t p = 0; p < share.size(); ++p) {
    const auto z = double{prediction[p]};
    const std::uint8_t found =
        share[p] > 0.5f
            ? nearer(people.middle, x.at(static_cast<double>(p % scene.grid.size)) * z, z)
            : std::uint8_t{0};
    for (std::uint8_t k = 1; k <= 2; ++k) {
      const bool here = people.person[p] == k, there = found == k;
      both[k - 1u] += here && there, any[k - 1u] += here || there;
    }
  }
  return (both[0] / std::max(any[0], 1.0) + both[1] / std::max(any[1], 1.0)) / 2;
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
// Metrics of maps of two people; the record's label names them. The true map tells the two apart:
// its foreground in plan view (x and z in metres) falls into two clusters (2-means, begun at the
// leftmost and the rightmost pixel). A predicted pixel belongs to the person whose middle in plan
// view is nearer.
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "recon/metrics/scene.hpp"

namespace echofuse::recon {

inline constexpr std::string_view two_people_label = "two_people";

struct TwoPeople {
  struct Middle {
    double x_m = 0, z_m = 0;
  };
  std::array<Middle, 2> middle;      // the left one first
  std::vector<std::uint8_t> person;  // for each pixel: 0 none, 1 left, 2 right
};

// Returns nothing if the map has no two pixels of foreground side by side.
std::optional<TwoPeople> find_people(std::span<const float> truth, const Scene& scene);

// Mean over both persons of the intersection over union of their own pixels, 0 to 1.
double iou_per_person(std::span<const float> prediction, const TwoPeople& people,
                      const Scene& scene);

}  // namespace echofuse::recon

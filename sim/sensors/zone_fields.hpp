// SPDX-License-Identifier: MIT
// Zones of the simulated detector: spd_zones x spd_zones parts of its field of view. Their fields
// are Gaussian, overlap like those of a TMF8820, and add up to 1 everywhere. So all zones together
// count as much as a single pixel.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/random.hpp"
#include "drivers/core/zone.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {

// Standard deviation of a field, relative to the spacing of the zones.
inline constexpr double zone_deviation = 0.75;

// Returns the zones for the run, row by row from the top left; empty for a single pixel.
// spd_yaw_deg is not applied, because the daemon does not know it.
Zones zones_of(const Conditions& conditions);

// Returns the expected detections per window (spd_rate) of each zone, zone by zone. The background
// is spread evenly over the zones. Several zones need returns with directions.
std::vector<double> zone_rates(const Returns& returns, const Conditions& conditions);

// Draws the counts of one window. Each zone has its own detector (draw_counts).
std::vector<std::uint32_t> draw_zone_counts(const std::vector<double>& rates,
                                            const Conditions& conditions, Rng& rng);

}  // namespace echofuse::sim

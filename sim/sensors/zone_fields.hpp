// SPDX-License-Identifier: MIT
// Zones of the simulated detector: spd_zones x spd_zones parts of its field of view. Their fields
// are Gaussian, overlap as those of a TMF8820, and add up to 1 everywhere, so that all zones
// together count what a single pixel counts.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/random.hpp"
#include "drivers/core/zone.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {

// Standard deviation of a field over the spacing of the zones.
inline constexpr double zone_deviation = 0.75;

// Zones as the run states them, row by row from the top left; empty for a single pixel. The daemon
// does not know spd_yaw_deg.
Zones zones_of(const Conditions& conditions);

// Expected detections of one window (spd_rate) in each zone, zone after zone. The background
// spreads evenly over the zones. Returns of several zones need their directions.
std::vector<double> zone_rates(const Returns& returns, const Conditions& conditions);

// Counts of one window. Each zone has its own detector (draw_counts).
std::vector<std::uint32_t> draw_zone_counts(const std::vector<double>& rates,
                                            const Conditions& conditions, Rng& rng);

}  // namespace echofuse::sim

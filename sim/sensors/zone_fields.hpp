// SPDX-License-Identifier: MIT
// Zones of the simulated detector: spd_zones x spd_zones parts of its field of view. The
// sensitivities of the zones are Gaussian, overlap like those of a TMF8820, and add up to 1 in each
// direction. So all zones together detect the same amount of light as a single pixel.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/random.hpp"
#include "drivers/core/zone.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {

// Standard deviation of the Gaussian sensitivity of a zone, relative to the spacing of the zones.
inline constexpr double zone_deviation = 0.75;

// Returns the zones to be stored in the run file, row by row from the top left. They do not include
// `spd_yaw_deg`, because it is unknown in a real laboratory.
Zones zones_of(const Conditions& conditions);

// Returns the expected number of detections in one window (spd_rate) for each zone and bin:
// [zone][bin]. The background is divided equally among the zones. If there are several zones,
// `returns` must include tangents.
std::vector<double> zone_rates(const Returns& returns, const Conditions& conditions);

// Draws the counts of one window: [zone][bin]. Each zone has a separate detector (draw_counts).
std::vector<std::uint32_t> draw_zone_counts(const std::vector<double>& rates,
                                            const Conditions& conditions, Rng& rng);

}  // namespace echofuse::sim

// SPDX-License-Identifier: MIT
// TCSPC histogram of the single-photon detector. The two-way time is t = 2R/c.
#pragma once
#include <cstdint>
#include <vector>

#include "acquire/measurement/detector.hpp"
#include "drivers/core/random.hpp"
#include "sim/scene/conditions.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {

// Returns the expected detections per bin in one window at low flux: r_i = signal_photons * sum_k
// w_k * integral over bin i of IRF(t - 2 R_k/c) dt + background/bins with a Gaussian IRF, or a
// Gaussian convolved with an exponential (irf_tail_ps).
std::vector<double> spd_rate(const Returns& returns, const Conditions& conditions);

// Draws the counts of one window. At low flux N_i ~ Poisson(r_i). With pulses_per_window = L > 0
// only the first photon of a pulse counts (Gupta et al., CVPR 2019): N ~ Multinomial(L, p), p_i =
// exp(-sum_{j<i} q_j) (1 - exp(-q_i)), q = r/L. With spd_dead_time_ps the detector is free-running:
// photons are processed in order over the L equal periods of window_s, and those within the dead
// time of the last detection are lost.
std::vector<std::uint32_t> draw_counts(const std::vector<double>& rate,
                                       const Conditions& conditions, Rng& rng);

// Returns the detector's properties to state in the run; none at low flux or without
// spd_detector_stated.
record::Detector stated_detector(const Conditions& conditions);

}  // namespace echofuse::sim

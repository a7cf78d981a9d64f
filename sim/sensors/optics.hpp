// SPDX-License-Identifier: MIT
// TCSPC histogram of the single-photon detector. The time of flight is t = 2R/c.
#pragma once
#include <cstdint>
#include <vector>

#include "acquire/measurement/detector.hpp"
#include "drivers/core/random.hpp"
#include "sim/scene/conditions.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {

// Returns the expected number of detections in each bin during one window at low flux:
//   r_i = signal_photons sum_k w_k (integral over bin i of IRF(t - 2 R_k/c) dt)
//         + background_counts / bins
// The IRF is a Gaussian or, if irf_tail_ps > 0, a Gaussian with an exponential tail.
std::vector<double> spd_rate(const Returns& returns, const Conditions& conditions);

// Draws the counts of one window from the expected numbers r_i. At low flux (pulses_per_window = 0)
// the counts are N_i ~ Poisson(r_i). If pulses_per_window = L > 0, only the first photon of a pulse
// is detected (Gupta et al., CVPR 2019):
//   N ~ Multinomial(L, p), p_i = exp(-sum_{j<i} q_j) (1 - exp(-q_i)), q_i = r_i / L
// If spd_dead_time_ps > 0 too, the detector is free-running. The photons of the L equal laser
// periods in window_s are processed in chronological order. Photons within the dead time of the
// previous detection are lost.
std::vector<std::uint32_t> draw_counts(const std::vector<double>& rate,
                                       const Conditions& conditions, Rng& rng);

// Returns the detector properties to be stored in the run file; empty at low flux, or if
// `spd_detector_stated` is false.
record::Detector stated_detector(const Conditions& conditions);

}  // namespace echofuse::sim

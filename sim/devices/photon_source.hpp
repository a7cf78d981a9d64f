// SPDX-License-Identifier: MIT
// Draws the detections of a pulsed laser and a single-photon detector one by one. The detections
// have the same distribution as the simulated histogram (sim/sensors/optics.hpp).
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "drivers/core/random.hpp"
#include "sim/scene/conditions.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {

struct Tagging {
  std::int32_t sync_channel = 1, click_channel = 2;
  double laser_rate_hz = 1e6;
  // if true, only the sync tags of pulses with a detection are sent
  bool conditional_filter = true;
};

// Random detections of the current scene. The number of detections in a window is
// Poisson-distributed, and each detection belongs to a random pulse. A signal photon belongs to a
// random return k, chosen with probability proportional to its weight. Its delay is 2 R_k/c plus
// jitter with the distribution of the IRF. Background detections are distributed uniformly over the
// bins of the histogram, as with a gated detector. If pulses_per_window > 0, the laser rate is
// pulses_per_window / window_s instead of laser_rate_hz. Only the first detection of each pulse is
// kept or, if spd_dead_time_ps > 0, each detection after the dead time of the previous one.
class PhotonSource {
 public:
  // Signal and background counts of the conditions are per `window_s` seconds. Throws Error(config)
  // if the laser period is shorter than the histogram, or if the tag rate exceeds the limit of the
  // simulator.
  PhotonSource(const Conditions& conditions, const Tagging& tagging, double window_s,
               std::uint64_t seed);

  double laser_rate_hz() const { return tagging_.laser_rate_hz; }
  void set_returns(const Returns& returns);
  // Multiplies the signal and background counts of the next draw() by `gain`.
  void set_gain(double gain) { gain_ = gain; }
  // Appends the tags of all pulses in [first, last) to `out`, in chronological order, and returns
  // their number. Pulse n is emitted at n / laser_rate_hz seconds.
  std::size_t draw(std::int64_t first, std::int64_t last, Bytes& out);
  // Returns the expected number of tags from this number of pulses.
  double mean_tags(std::int64_t pulses) const;

 private:
  double windows(std::int64_t pulses) const;
  double mean_signal(std::int64_t pulses) const;
  double mean_background(std::int64_t pulses) const;
  void draw_detections(std::int64_t pulses, double mean, bool signal);
  bool only_first() const;
  double signal_delay_ps();
  double background_delay_ps();
  void wait_for_detector(std::int64_t first);
  std::size_t put_pulse(std::int64_t pulse, std::size_t& next, std::int64_t first, Bytes& out);

  Conditions conditions_;
  Tagging tagging_;
  double window_s_, period_ps_, gain_ = 1;
  Rng rng_;
  std::normal_distribution<double> jitter_;
  double ready_ps_ = 0;  // time at which the current dead time ends, ps
  // Delay of each return of the scene, ps, and the cumulative sum of the weights.
  std::vector<double> delay_ps_, cumulative_;
  std::vector<std::uint64_t> detections_;  // detections of one draw(): pulse << 32 | delay in ps
};

}  // namespace echofuse::sim

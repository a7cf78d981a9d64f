// SPDX-License-Identifier: MIT
// Detections of a pulsed laser and a single-photon detector, drawn photon by photon from the
// distribution of the simulated histogram (sim/sensors/optics.hpp).
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
  // sends only syncs that a detection follows
  bool conditional_filter = true;
};

// The number of detections in a window is Poisson; each falls in a random pulse. A signal photon
// belongs to a return drawn by weight; its delay is 2R/c plus the IRF's jitter. Background is
// uniform over the histogram's bins, as with a gated detector. With pulses_per_window > 0 the laser
// fires that often per window, independent of laser_rate_hz. Then only the first detection of a
// pulse is kept; with spd_dead_time_ps, those outside the dead time of the last one kept.
class PhotonSource {
 public:
  // Signal and background counts are per window_s seconds. Throws Error(config) if a period is
  // shorter than the histogram, or the tag rate exceeds the simulator's limit.
  PhotonSource(const Conditions& conditions, const Tagging& tagging, double window_s,
               std::uint64_t seed);

  double laser_rate_hz() const { return tagging_.laser_rate_hz; }
  // Sets the scene of the next draw.
  void set_returns(const Returns& returns);
  // Scales signal and background from the next draw on.
  void set_gain(double gain) { gain_ = gain; }
  // Appends all tags of the pulses [first, last) to `out`, sorted by time; returns their number.
  // Pulse n fires at n / laser_rate_hz seconds.
  std::size_t draw(std::int64_t first, std::int64_t last, Bytes& out);
  // Returns the expected number of tags.
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
  double ready_ps_ = 0;                        // end of the dead time
  std::vector<double> delay_ps_, cumulative_;  // delays and summed weights of the scene's returns
  std::vector<std::uint64_t> detections_;      // pulse << 32 | delay in ps, scratch
};

}  // namespace echofuse::sim

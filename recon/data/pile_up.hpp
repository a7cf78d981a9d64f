// SPDX-License-Identifier: MIT
// Pile-up correction: converts the counts of a histogram to those of a detector without dead time.
// L pulses are sent. In bin i the detector is dead for B_i of these pulses, because a click
// occurred less than one dead time earlier. The other L - B_i pulses give N_i clicks in bin i, so
// the expected number of photons per pulse is
//   q_i = -log(1 - N_i / (L - B_i))
// If only the first photon of a pulse counts, B_i is the sum of all earlier bins (Coates, J. Phys.
// E 1, 878, 1968). For a free-running detector B_i is the sum of the bins within the dead time,
// including those of previous pulses (Isbaner et al., Opt. Express 24, 9429, 2016). Clicks outside
// the histogram are unknown, so the correction ignores them.
#pragma once
#include <span>

#include "acquire/record/fused_record.hpp"

namespace echofuse::recon {

class PileUp {
 public:
  PileUp() = default;  // the detector is unknown, so that counts are not corrected
  // Uses the detector described in the run (record::detector_of). The detector is unknown if the
  // run does not describe it, the axis `spd` is not in ps, or the slot length is impossible.
  PileUp(const record::RunInfo& info, const Axis& spd);

  // If the dead time is infinite, only the first photon of each pulse is counted, and the detector
  // is ready again at the next pulse. `window_s`: slot duration, s.
  PileUp(double dead_time_ps, double window_s, double bin_width_ps)
      : dead_time_ps_(dead_time_ps), window_ps_(1e12 * window_s), bin_width_ps_(bin_width_ps) {}

  bool known() const { return dead_time_ps_ > 0; }
  // Converts counts per bin to photons per bin in place. `pulses`: number of laser pulses in the
  // slot (0: unknown, no correction). For each bin, the detector is ready in a fraction of the
  // pulses; returns the smallest of these fractions. If it is near zero, the result is unreliable.
  double correct(std::span<float> counts, double pulses) const;

 private:
  double dead_time_ps_ = 0;
  double window_ps_ = 0, bin_width_ps_ = 0;
};

}  // namespace echofuse::recon

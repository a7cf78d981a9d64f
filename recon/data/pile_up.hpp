// SPDX-License-Identifier: MIT
// PileUp turns the counts of a histogram into those that a detector without dead time would have. L
// pulses are sent. At bin i the detector is not ready after the B_i pulses whose click was less
// than the dead time before. L - B_i pulses find it ready, and N_i of these click in bin i, so a
// pulse brings
//   q_i = -log(1 - N_i / (L - B_i))
// photons there. If only the first photon of a pulse counts, B_i is all earlier bins (Coates, J.
// Phys. E 1, 878, 1968). If the detector runs freely, B_i is the bins within the dead time, also of
// the pulses before (Isbaner et al., Opt. Express 24, 9429, 2016). Clicks outside the histogram are
// not known, and not corrected for.
#pragma once
#include <span>

#include "acquire/record/run_file.hpp"

namespace echofuse::recon {

class PileUp {
 public:
  PileUp() = default;  // for an unknown detector, whose counts stay as they are
  // The detector is what the run says (record::detector_of). It is unknown if the run says nothing,
  // or if the axis `spd` is not in ps.
  PileUp(const record::RunReader& run, const Axis& spd);

  // With an infinite dead time the detector is ready again at the next pulse. `window_s` is the
  // length of the slot.
  PileUp(double dead_time_ps, double window_s, double bin_width_ps)
      : dead_time_ps_(dead_time_ps), window_ps_(1e12 * window_s), bin_width_ps_(bin_width_ps) {}

  bool known() const { return dead_time_ps_ > 0; }
  // In place, counts a bin become photons a bin, for `pulses` laser pulses in the slot (0: not
  // known, nothing is done). Returns the least share of the pulses that found the detector ready:
  // if it is nearly zero, the photons are a guess.
  double correct(std::span<float> counts, double pulses) const;

 private:
  double dead_time_ps_ = 0;
  double window_ps_ = 0, bin_width_ps_ = 0;
};

}  // namespace echofuse::recon

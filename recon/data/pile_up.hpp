// SPDX-License-Identifier: MIT
// Counts of a histogram as a detector without dead time would have counted them.
// Of L pulses, those that find the detector ready at bin i are L less the B_i whose click was less
// than the dead time before; of these N_i click in bin i, so a pulse brings
//   q_i = -log(1 - N_i / (L - B_i))
// photons there. First photon of a pulse: B_i is all earlier bins (Coates, J. Phys. E 1, 878,
// 1968). Free-running: the bins within the dead time, also of the pulses before (Isbaner et al.,
// Opt. Express 24, 9429, 2016). Clicks outside the histogram are not known, and not corrected for.
#pragma once
#include <span>

#include "acquire/record/run_file.hpp"

namespace echofuse::recon {

class PileUp {
 public:
  PileUp() = default;  // of an unknown detector, whose counts stay as they are
  // As the run says (record::detector_of); a run that says nothing is of an unknown detector, and
  // so is one whose axis `spd` is not in ps.
  PileUp(const record::RunReader& run, const Axis& spd);

  // Infinite: the detector is ready again with the next pulse. `window_s`: of the slot.
  PileUp(double dead_time_ps, double window_s, double bin_width_ps)
      : dead_time_ps_(dead_time_ps), window_ps_(1e12 * window_s), bin_width_ps_(bin_width_ps) {}

  bool known() const { return dead_time_ps_ > 0; }
  // In place: counts a bin become photons a bin, of `pulses` laser pulses in the slot (0: not
  // known, nothing is done). Returns the least share of the pulses that found the detector ready:
  // where it is hardly any, the photons are a guess.
  double correct(std::span<float> counts, double pulses) const;

 private:
  double dead_time_ps_ = 0;
  double window_ps_ = 0, bin_width_ps_ = 0;
};

}  // namespace echofuse::recon

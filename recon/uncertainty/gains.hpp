// SPDX-License-Identifier: MIT
// Whether gains are still those of the training, of a model that was promised so (--gains stable):
// the mean brightness of a run's bodies against the training's. People who stand to one side move
// it as well (by 4 b / r^2 a metre, brightness.hpp); either way nothing is lost but what brightness
// brings, so there is no need to tell the two apart.
#pragma once
#include <string>

#include "recon/models/body/alignment.hpp"

namespace echofuse::recon {

struct GainCheck {
  std::size_t records = 0;    // with a body and a known brightness; none: nobody asked
  double change = 0;          // of the radar's power against the clicks, as a share
  double standard_error = 0;  // of blocks of ten records
  bool stable = false;
  std::string text() const;  // for the user; empty if there is nothing to say
};

GainCheck check_gains(const Alignment& alignment, const Matrix& aligned);

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#pragma once
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

// One row a record: how probably a body is at each pixel if it is where the model puts it, and how
// far away (metres) it is there if so.
struct SoftMaps {
  Matrix foreground_probability, depth;
};

}  // namespace echofuse::recon

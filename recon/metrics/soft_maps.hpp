// SPDX-License-Identifier: MIT
#pragma once
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

// There is one row a record. It holds how probably a body is at each pixel if the body is where the
// model puts it, and how far away (metres) the body is there in that case.
struct SoftMaps {
  Matrix foreground_probability, depth;
};

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#pragma once

namespace echofuse::recon {

// The points in space of the page of `echofuse-view` (recon/view/page), as one script: class Cloud.
extern const char* const cloud_code;

}  // namespace echofuse::recon

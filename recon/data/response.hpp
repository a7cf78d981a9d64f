// SPDX-License-Identifier: MIT
#pragma once
#include <string>
#include <utility>
#include <vector>

#include "acquire/measurement/response.hpp"

namespace echofuse::recon {

struct RunResponse {
  // Response stored in the run file or, after a conversion, the response to which the run was
  // converted (response_conversion.hpp).
  record::RadarResponse radar = {};
  // Effect of the conversion: the old width divided by the new one, and the factor by which white
  // noise was amplified.
  double times_wider = 1, noise_factor = 1;

  static RunResponse read(const std::vector<std::pair<std::string, std::string>>& meta) {
    return {record::response_of(meta).radar};
  }
};

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#pragma once
#include <string>
#include <vector>

namespace echofuse::depth {

struct OpenNiDevice {
  std::string uri, model;
};

// The cameras that OpenNI2's modules see now. Throws Error(device) if there are no modules.
std::vector<OpenNiDevice> list_openni_devices();

}  // namespace echofuse::depth

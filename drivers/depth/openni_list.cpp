// SPDX-License-Identifier: MIT
#include "drivers/depth/openni_list.hpp"

#include "drivers/depth/openni_session.hpp"

namespace echofuse::depth {

std::vector<OpenNiDevice> list_openni_devices() {
  initialize_openni();
  openni::Array<openni::DeviceInfo> found;
  openni::OpenNI::enumerateDevices(&found);
  std::vector<OpenNiDevice> out;
  for (int i = 0; i < found.getSize(); ++i)
    out.push_back(
        {found[i].getUri(), std::string(found[i].getVendor()) + " " + found[i].getName()});
  return out;
}

}  // namespace echofuse::depth

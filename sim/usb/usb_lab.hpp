// SPDX-License-Identifier: MIT
// The part of a laboratory that is on emulated USB. A build without umockdev has none.
#pragma once
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "sim/devices/device.hpp"

namespace echofuse::sim {

class UsbLab {
 public:
  // Starts this program anew where the emulation works, if need be; call it before anything else.
  // Throws Error(failed) where there is no emulation.
  static void enter(char** argv);
  static std::unique_ptr<UsbLab> make(boost::asio::io_context& io, ScenePlayer& player,
                                      const TdcOptions& tdc);

  virtual ~UsbLab() = default;
  // What a program that is to see the devices needs in its environment.
  virtual std::vector<std::pair<std::string, std::string>> environment() const = 0;
  virtual std::string tdc_address() const = 0;
  virtual Device& tdc() = 0;
};

}  // namespace echofuse::sim

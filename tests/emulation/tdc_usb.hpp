// SPDX-License-Identifier: MIT
// A time tagger on emulated USB: the device side of drivers/README.md, "Over USB".
#pragma once
#include <memory>

#include "drivers/port/loop.hpp"
#include "sim/devices/device.hpp"
#include "tests/emulation/usb_device.hpp"

namespace echofuse::sim {

// The device ends a transfer every 5 ms. What the host does not fetch waits in its FIFO; of tags
// that have no room there the next block says how many they are. Threading: the loop's thread.
class TdcUsb : public Device {
 public:
  static constexpr std::uint16_t vendor = 0x1209, product = 0x0001;  // pid.codes: private tests

  virtual std::string address() const = 0;  // "usb:1209:0001:SERIAL"
  virtual UsbDevice& usb() = 0;             // to plug, unplug, halt
};
std::unique_ptr<TdcUsb> make_tdc_usb(port::SystemLoop& loop, ScenePlayer& player, UsbBed& bed,
                                     const TdcOptions& options);

}  // namespace echofuse::sim

// SPDX-License-Identifier: MIT
// Time tagger on emulated USB: the device side of drivers/README.md, "Over USB".
#pragma once
#include <memory>

#include "drivers/port/loop.hpp"
#include "sim/devices/device.hpp"
#include "tests/emulation/usb_device.hpp"

namespace echofuse::sim {

// Ends a transfer every 5 ms. Unread data wait in the FIFO; tags that do not fit are dropped, and
// counted in the next block. Threading: loop's thread.
class TdcUsb : public Device {
 public:
  static constexpr std::uint16_t vendor = 0x1209, product = 0x0001;  // pid.codes: private tests

  virtual std::string address() const = 0;  // "usb:1209:0001:SERIAL"
  virtual UsbDevice& usb() = 0;             // for plug, unplug and halt
};
std::unique_ptr<TdcUsb> make_tdc_usb(port::SystemLoop& loop, ScenePlayer& player, UsbBed& bed,
                                     const TdcOptions& options);

}  // namespace echofuse::sim

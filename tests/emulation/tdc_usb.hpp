// SPDX-License-Identifier: MIT
// Time tagger on an emulated USB bus: the device side of drivers/BRIDGES.md,
// bridge protocol over USB.
#pragma once

#include "drivers/port/loop.hpp"
#include "sim/devices/device.hpp"
#include "tests/emulation/usb_device.hpp"

namespace echofuse::sim {

// Simulated USB tagger that ends a transfer every 5 ms. Unread data wait in the tagger's FIFO. Tags
// that do not fit into the FIFO are dropped, and their number is reported in the next block. Must
// be used only on the loop's thread.
class TdcUsb : public Device {
 public:
  // The IDs are reserved by pid.codes for private tests.
  static constexpr std::uint16_t vendor = 0x1209, product = 0x0001;

  virtual std::string address() const = 0;  // address of the form "usb:1209:0001:SERIAL"
  virtual UsbDevice& usb() = 0;  // emulated USB side, for example to unplug or halt the device
};
std::unique_ptr<TdcUsb> make_tdc_usb(port::SystemLoop& loop, ScenePlayer& player, UsbBed& bed,
                                     const TdcOptions& options);

}  // namespace echofuse::sim

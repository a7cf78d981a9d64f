// SPDX-License-Identifier: MIT
// A time tagger on emulated USB: the device side of drivers/tdc/USB.md.
#pragma once
#include <memory>

#include "sim/devices/device.hpp"
#include "tests/emulation/usb_device.hpp"

namespace echofuse::sim {

// The device sends a run every 5 ms. What the host does not fetch waits in its FIFO; when that is
// full, tags are lost, and said to be: overflow begin, missed events of each channel, overflow end.
// Threading: one io thread.
class TdcUsb : public Device {
 public:
  static constexpr std::uint16_t vendor = 0x1209, product = 0x0001;  // pid.codes: private tests

  virtual std::string address() const = 0;  // "usb:1209:0001:SERIAL"
  virtual UsbDevice& usb() = 0;             // to plug, unplug, halt
};
std::unique_ptr<TdcUsb> make_tdc_usb(boost::asio::io_context& io, ScenePlayer& player, UsbBed& bed,
                                     const TdcOptions& options);

}  // namespace echofuse::sim

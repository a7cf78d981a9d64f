// SPDX-License-Identifier: MIT
// Time tagger on an emulated USB bus: the device side of drivers/BRIDGES.md,
// bridge protocol over USB.
#pragma once

#include "drivers/port/loop.hpp"
#include "sim/devices/device.hpp"
#include "tests/emulation/usb_device.hpp"

namespace echofuse::sim {

// The IDs are reserved by pid.codes for private tests.
inline constexpr char tdc_usb_address[] = "usb:1209:0001:SIM-USB-1";

// Simulated USB tagger that ends a transfer every 5 ms. Unread data wait in the tagger's FIFO. Tags
// that do not fit into the FIFO are dropped, and their number is reported in the next block. Must
// be used only on the loop's thread.
std::unique_ptr<Device> make_tdc_usb(port::SystemLoop& loop, ScenePlayer& player, UsbBed& bed,
                                     const TdcOptions& options);

}  // namespace echofuse::sim

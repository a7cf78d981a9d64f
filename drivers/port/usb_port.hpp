// SPDX-License-Identifier: MIT
#pragma once
#include <memory>
#include <string>

#include "drivers/port/address.hpp"
#include "drivers/port/byte_port.hpp"

namespace echofuse::port {

// A device that streams over a USB bulk endpoint (drivers/README.md, "Over USB"), through libusb.
// Found by its vendor, product and serial number, or the only one if the address has no serial
// number; opened exclusively. The device takes no bytes. A transfer that fails, and an endpoint
// that halts, end the port: bytes are missing. Threading: as BytePort. A thread of its own makes
// all libusb calls; it asks for no more while 64 MiB wait for the loop's thread, and what the
// device cannot keep meanwhile is the device's loss.
std::unique_ptr<BytePort> make_usb_port(boost::asio::io_context& io, const std::string& name,
                                        const UsbAddress& address);

// The interface by which a device says that it streams blocks.
inline constexpr std::uint8_t usb_class = 0xff, usb_subclass = 0x45, usb_protocol = 0x01;
// Vendor requests to the interface, without data: bmRequestType, and bRequest.
inline constexpr std::uint8_t usb_vendor_out = 0x41, usb_start = 1, usb_stop = 2;

// What a port's transfers take of the kernel's usbfs memory.
inline constexpr std::size_t usb_ring_bytes = std::size_t{2} << 20;

}  // namespace echofuse::port

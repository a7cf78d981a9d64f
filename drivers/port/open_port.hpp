// SPDX-License-Identifier: MIT
// Ports of all byte transports. Threading: as BytePort. HID and USB have a thread each, which
// alone calls the library from open to close.
#pragma once
#include <cstdint>
#include <string>

#include "drivers/port/address.hpp"
#include "drivers/port/byte_port.hpp"

namespace echofuse::port {

// Throws Error(config) for an address that carries no byte stream, or a baud rate that a HID bridge
// cannot do.
ByteOpener byte_opener(boost::asio::io_context& io, const std::string& address, std::uint32_t baud);

// Makes a port of 8N1 without flow control, opened exclusively (flock, TIOCEXCL). Bytes that the
// line held before are thrown away. `baud` must be one of the rates that termios names (9600 ...
// 115200, 921600, 3000000).
std::unique_ptr<BytePort> make_serial_port(boost::asio::io_context& io, const std::string& path,
                                           std::uint32_t baud);

// A client connection. Resolving and connecting do not block and have no time limit of their own:
// drivers watch for silence.
std::unique_ptr<BytePort> make_tcp_port(boost::asio::io_context& io, const std::string& host,
                                        std::uint16_t port);

// Makes a port for a UART behind a CP2110 HID bridge (cp2110.hpp), through hidapi's hidraw backend.
// 8N1 without flow control; bytes that the bridge held before are thrown away. Found by serial
// number, or the only one if the address has none; opened exclusively. Warns of a baud rate that
// the bridge's USB pipe cannot carry, and of bytes that the io thread left too long. Also warns of
// overruns in the bridge, asked about once a second. Destroying the port waits for the transfer
// that is under way.
std::unique_ptr<BytePort> make_hid_port(boost::asio::io_context& io, const HidAddress& address,
                                        std::uint32_t baud);
// Throws Error(config) for a rate that the bridge cannot do.
void check_hid_baud(const HidAddress& address, std::uint32_t baud);

// A device that streams over a USB bulk endpoint (drivers/README.md, "Over USB"), through libusb.
// Found by its vendor, product and serial number, or the only one if the address has no serial
// number; opened exclusively. The device takes no bytes. A transfer that fails, and an endpoint
// that halts, end the port: bytes are missing. No more is asked for while 64 MiB wait for the
// loop's thread, and what the device cannot keep meanwhile is the device's loss.
std::unique_ptr<BytePort> make_usb_port(boost::asio::io_context& io, const std::string& name,
                                        const UsbAddress& address);

// The interface by which a device says that it streams blocks.
inline constexpr std::uint8_t usb_class = 0xff, usb_subclass = 0x45, usb_protocol = 0x01;
// Vendor requests to the interface, without data: bmRequestType, and bRequest.
inline constexpr std::uint8_t usb_vendor_out = 0x41, usb_start = 1, usb_stop = 2;
// Kernel's usbfs memory that a port's transfers take, bytes.
inline constexpr std::size_t usb_ring_bytes = std::size_t{2} << 20;

}  // namespace echofuse::port

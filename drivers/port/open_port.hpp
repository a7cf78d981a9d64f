// SPDX-License-Identifier: MIT
// Opens ports of all transports. Threading: see BytePort. HID and USB ports have one thread each,
// which makes all calls of the library.
#pragma once
#include <cstdint>
#include <string>

#include "drivers/port/address.hpp"
#include "drivers/port/byte_port.hpp"

namespace echofuse::port {

// Throws Error(config) for an address without a byte stream, or a baud rate that a HID bridge does
// not support.
ByteOpener byte_opener(boost::asio::io_context& io, const std::string& address, std::uint32_t baud);

// Opens a serial port, 8N1, no flow control, exclusively (flock, TIOCEXCL). Discards bytes received
// before. `baud` must be a termios rate (9600 ... 115200, 921600, 3000000).
std::unique_ptr<BytePort> make_serial_port(boost::asio::io_context& io, const std::string& path,
                                           std::uint32_t baud);

// Connects as a client. Resolving and connecting do not block and have no timeout; drivers detect
// silence.
std::unique_ptr<BytePort> make_tcp_port(boost::asio::io_context& io, const std::string& host,
                                        std::uint16_t port);

// Opens a UART behind a CP2110 HID bridge (cp2110.hpp) with hidapi's hidraw backend, exclusively,
// 8N1, no flow control. Discards bytes received before. Selects by serial number, or the only
// device if the address has none. Warns if the baud rate exceeds the USB pipe, and if the io thread
// reads too late. Polls the bridge once a second and warns of overruns. The destructor waits for
// the current transfer.
std::unique_ptr<BytePort> make_hid_port(boost::asio::io_context& io, const HidAddress& address,
                                        std::uint32_t baud);
// Throws Error(config) for a rate that the bridge does not support.
void check_hid_baud(const HidAddress& address, std::uint32_t baud);

// Opens a device that streams over a USB bulk endpoint (drivers/README.md, "Over USB"), with
// libusb, exclusively. Selects by vendor, product and serial number, or the only device if the
// address has no serial number. Writes are ignored. A failed transfer or a halted endpoint closes
// the port, because bytes are missing. Requests no data while 64 MiB wait for the loop's thread;
// the device then drops what it cannot buffer.
std::unique_ptr<BytePort> make_usb_port(boost::asio::io_context& io, const std::string& name,
                                        const UsbAddress& address);

// USB interface descriptor of a block stream.
inline constexpr std::uint8_t usb_class = 0xff, usb_subclass = 0x45, usb_protocol = 0x01;
// Vendor requests to the interface, without data: bmRequestType and bRequest.
inline constexpr std::uint8_t usb_vendor_out = 0x41, usb_start = 1, usb_stop = 2;
// usbfs memory of a port's transfers, bytes.
inline constexpr std::size_t usb_ring_bytes = std::size_t{2} << 20;

}  // namespace echofuse::port

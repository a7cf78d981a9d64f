// SPDX-License-Identifier: MIT
// Opens ports of all transports. Threading: see BytePort. Each HID or USB port has its own thread,
// which makes all calls to hidapi or libusb.
#pragma once
#include <cstdint>
#include <string>

#include "drivers/port/address.hpp"
#include "drivers/port/byte_port.hpp"

namespace echofuse::port {

// Throws Error(config) if the address does not refer to a byte stream, or if a HID bridge does not
// support the baud rate.
ByteOpener byte_opener(boost::asio::io_context& io, const std::string& address, std::uint32_t baud);

// Opens a serial port with 8N1 and no flow control. Other programs cannot open it (flock,
// TIOCEXCL). Bytes received before the port was opened are discarded. `baud` must be a termios rate
// (9600 ... 115200, 921600, 3000000).
std::unique_ptr<BytePort> make_serial_port(boost::asio::io_context& io, const std::string& path,
                                           std::uint32_t baud);

// Connects as a TCP client. Name resolution and connection run in the background. They need no
// timeout, because the drivers detect a connection that delivers no data.
std::unique_ptr<BytePort> make_tcp_port(boost::asio::io_context& io, const std::string& host,
                                        std::uint16_t port);

// Opens the UART of a CP2110 HID bridge (cp2110.hpp) with 8N1 and no flow control, using hidapi's
// hidraw backend. The bridge is locked against other echofuse programs. Bytes received before it
// was opened are discarded. If the address contains no serial number, exactly one bridge must
// match. Warns if the baud rate exceeds the throughput of USB, or if the loop's thread falls
// behind. Polls the bridge once a second and warns of overruns. The destructor waits up to 0.2 s
// for the current transfer to finish.
std::unique_ptr<BytePort> make_hid_port(boost::asio::io_context& io, const HidAddress& address,
                                        std::uint32_t baud);
// Throws Error(config) if the bridge does not support the rate.
void check_hid_baud(const HidAddress& address, std::uint32_t baud);

// Opens a device that streams over a USB bulk endpoint (drivers/BRIDGES.md) with libusb.
// Other programs cannot use its interface. If the address contains no serial number, exactly one
// device must match. Writes are ignored. A failed transfer or a halted endpoint closes the port,
// because bytes have been lost. While 64 MiB are waiting for the loop's thread, the port requests
// no more data, and the device drops data that it cannot buffer.
std::unique_ptr<BytePort> make_usb_port(boost::asio::io_context& io, const std::string& name,
                                        const UsbAddress& address);

// Class, subclass and protocol codes of a USB interface that sends a block stream.
inline constexpr std::uint8_t usb_class = 0xff, usb_subclass = 0x45, usb_protocol = 0x01;
// Vendor requests to the interface, without a data stage: bmRequestType, followed by the bRequest
// values for start and stop.
inline constexpr std::uint8_t usb_vendor_out = 0x41, usb_start = 1, usb_stop = 2;
// Memory in bytes that a port's transfers occupy in usbfs.
inline constexpr std::size_t usb_ring_bytes = std::size_t{2} << 20;

}  // namespace echofuse::port

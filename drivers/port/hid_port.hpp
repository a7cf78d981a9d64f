// SPDX-License-Identifier: MIT
#pragma once
#include <memory>

#include "drivers/port/address.hpp"
#include "drivers/port/byte_port.hpp"

namespace echofuse::port {

// A UART behind a CP2110 HID bridge (cp2110.hpp), through hidapi's hidraw backend: 8N1 without flow
// control, what the bridge held before is thrown away. Found by serial number, or the only one
// if the address has none; opened exclusively. Warns of a baud rate that the bridge's USB pipe
// cannot carry, of overruns in the bridge (asked about once a second) and of bytes that the io
// thread left too long. Threading: as BytePort. One thread of its own owns the HID device from open
// to close: hidapi is not safe for two, and opening, writing and feature reports block for a USB
// transfer (which the kernel limits to seconds). Destroying the port waits for the transfer that is
// under way.
std::unique_ptr<BytePort> make_hid_port(boost::asio::io_context& io, const HidAddress& address,
                                        std::uint32_t baud);

// Throws Error(config) for a rate that the bridge cannot do.
void check_hid_baud(const HidAddress& address, std::uint32_t baud);

}  // namespace echofuse::port

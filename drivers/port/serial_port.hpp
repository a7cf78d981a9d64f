// SPDX-License-Identifier: MIT
#pragma once
#include <memory>
#include <string>

#include "drivers/port/byte_port.hpp"

namespace echofuse::port {

// 8N1 without flow control, opened exclusively (flock, TIOCEXCL). What the line held before it was
// opened is thrown away. `baud` must be
// one of the rates that termios names (9600 ... 115200, 921600, 3000000).
std::unique_ptr<BytePort> make_serial_port(boost::asio::io_context& io, const std::string& path,
                                           std::uint32_t baud);

}  // namespace echofuse::port

// SPDX-License-Identifier: MIT
#pragma once
#include <memory>
#include <string>

#include "drivers/port/byte_port.hpp"

namespace echofuse::port {

// A client connection. Resolving and connecting do not block and have no time limit of their own:
// drivers watch for silence.
std::unique_ptr<BytePort> make_tcp_port(boost::asio::io_context& io, const std::string& host,
                                        std::uint16_t port);

}  // namespace echofuse::port

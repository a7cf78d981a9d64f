// SPDX-License-Identifier: MIT
// The only list of byte transports.
#pragma once
#include <cstdint>
#include <string>

#include "drivers/port/address.hpp"
#include "drivers/port/byte_port.hpp"

namespace echofuse::port {

// Throws Error(config) for an address that carries no byte stream, or a baud rate that a HID bridge
// cannot do.
ByteOpener byte_opener(boost::asio::io_context& io, const std::string& address, std::uint32_t baud);

}  // namespace echofuse::port

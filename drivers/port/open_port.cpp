// SPDX-License-Identifier: MIT
#include "drivers/port/open_port.hpp"

#include "drivers/util/exit_code.hpp"

namespace echofuse::port {

ByteOpener byte_opener(boost::asio::io_context& io, const std::string& address,
                       std::uint32_t baud) {
  const Address parsed = parse_address(address);
  if (const auto* serial = std::get_if<SerialAddress>(&parsed))
    return [&io, path = serial->path, baud] { return make_serial_port(io, path, baud); };
  if (const auto* bridge = std::get_if<BridgeAddress>(&parsed))
    return [&io, to = *bridge] { return make_tcp_port(io, to.host, to.port); };
  if (const auto* usb = std::get_if<UsbAddress>(&parsed))
    return [&io, address, to = *usb] { return make_usb_port(io, address, to); };
  if (const auto* hid = std::get_if<HidAddress>(&parsed)) {
    check_hid_baud(*hid, baud);
    return [&io, to = *hid, baud] { return make_hid_port(io, to, baud); };
  }
  throw Error(ExitCode::config, "address \"" + address +
                                    "\" is not the address of a byte stream; expected one that "
                                    "begins with bridge:, usb:, hid: or serial:");
}

}  // namespace echofuse::port

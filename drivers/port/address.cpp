// SPDX-License-Identifier: MIT
#include "drivers/port/address.hpp"

#include <charconv>

#include "drivers/util/exit_code.hpp"

namespace echofuse::port {
namespace {

[[noreturn]] void refuse(std::string_view text, const std::string& expected) {
  throw Error(ExitCode::config, "address \"" + std::string(text) + "\": expected " + expected);
}

template <class Number>
bool parse_whole(std::string_view text, int base, Number& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  return error == std::errc{} && end == text.data() + text.size();
}

bool take_prefix(std::string_view& text, std::string_view prefix) {
  if (!text.starts_with(prefix)) return false;
  text.remove_prefix(prefix.size());
  return true;
}

BridgeAddress parse_bridge(std::string_view text, std::string_view rest) {
  const std::string expected = "bridge:tcp://HOST:PORT";
  if (!take_prefix(rest, "tcp://")) refuse(text, expected);
  const std::size_t colon = rest.rfind(':');
  BridgeAddress address;
  if (colon == rest.npos || !parse_whole(rest.substr(colon + 1), 10, address.port) ||
      address.port == 0)
    refuse(text, expected + " with a port from 1 to 65535");
  std::string_view host = rest.substr(0, colon);
  const bool bracketed = host.size() > 2 && host.front() == '[' && host.back() == ']';
  if (bracketed) host = host.substr(1, host.size() - 2);
  if (host.empty() || host.find_first_of(bracketed ? "/[] " : "/:[] ") != host.npos)
    refuse(text, expected + " (IPv6 addresses in brackets)");
  address.host = host;
  return address;
}

template <class Result>
Result parse_ids(std::string_view text, std::string_view rest, const char* kind) {
  Result address;
  const bool shape = rest.size() >= 9 && rest[4] == ':' && (rest.size() == 9 || rest[9] == ':');
  const std::string ids = std::string(kind) + ":VVVV:PPPP";
  if (!shape || !parse_whole(rest.substr(0, 4), 16, address.vendor) ||
      !parse_whole(rest.substr(5, 4), 16, address.product) || rest.size() == 10)
    refuse(text,
           ids + " or " + ids + ":SERIAL, with four hexadecimal digits for VVVV and for PPPP");
  if (rest.size() > 10) address.serial = rest.substr(10);
  return address;
}

}  // namespace

Address parse_address(std::string_view text) {
  std::string_view rest = text;
  if (take_prefix(rest, "bridge:")) return parse_bridge(text, rest);
  if (take_prefix(rest, "usb:")) return parse_ids<UsbAddress>(text, rest, "usb");
  if (take_prefix(rest, "hid:")) return parse_ids<HidAddress>(text, rest, "hid");
  if (take_prefix(rest, "openni:")) return OpenNiAddress{std::string(rest)};
  if (take_prefix(rest, "serial:")) {
    if (!rest.starts_with('/')) refuse(text, "serial:/dev/... with an absolute path");
    return SerialAddress{std::string(rest)};
  }
  return OtherAddress{std::string(text)};
}

}  // namespace echofuse::port

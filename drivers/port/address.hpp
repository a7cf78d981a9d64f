// SPDX-License-Identifier: MIT
// Address syntax of the configuration.
//   bridge:tcp://HOST:PORT      HOST is a name, an IPv4 address or an IPv6 address in brackets
//   usb:VVVV:PPPP[:serial]      vendor and product in hexadecimal
//   hid:VVVV:PPPP[:serial]
//   serial:/dev/...             any absolute path
//   openni:[URI or file.oni]    without a URI: the only attached camera
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <variant>

namespace echofuse::port {

struct BridgeAddress {
  std::string host;
  std::uint16_t port = 0;
  bool operator==(const BridgeAddress&) const = default;
};
struct UsbAddress {
  std::uint16_t vendor = 0, product = 0;
  std::string serial;
  bool operator==(const UsbAddress&) const = default;
};
struct HidAddress {
  std::uint16_t vendor = 0, product = 0;
  std::string serial;
  bool operator==(const HidAddress&) const = default;
};
struct SerialAddress {
  std::string path;
  bool operator==(const SerialAddress&) const = default;
};
struct OpenNiAddress {
  std::string uri;
  bool operator==(const OpenNiAddress&) const = default;
};
struct OtherAddress {  // address of a driver that reads its device itself
  std::string text;
  bool operator==(const OtherAddress&) const = default;
};
using Address =
    std::variant<BridgeAddress, UsbAddress, HidAddress, SerialAddress, OpenNiAddress, OtherAddress>;

// If an address of the listed syntax is invalid, throws Error(config) with the address and the
// expected syntax.
Address parse_address(std::string_view text);

}  // namespace echofuse::port

// SPDX-License-Identifier: MIT
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "drivers/bridge/bridge_protocol.hpp"

namespace echofuse::bridge {
namespace {

using nlohmann::json;

Failure fault(const std::string& what) {
  return {std::make_error_code(std::errc::bad_message), "the hello block is not valid: " + what};
}

// Returns the reason why an entry of the list of zones is not a zone, or an empty string.
std::string take_zone(const json& entry, Zone& zone) {
  if (!entry.is_object()) return "is not an object";
  for (const auto& [key, value] : {std::pair{"x", &zone.x},
                                   {"y", &zone.y},
                                   {"width", &zone.width},
                                   {"zero_ps", &zone.zero_ps}}) {
    const auto given = entry.find(key);
    if (given == entry.end()) continue;
    if (!given->is_number()) return std::string("has a \"") + key + "\" that is not a number";
    *value = given->get<double>();
  }
  if (zone.plausible()) return {};
  return "has impossible values; expected x, y and width together (tangents, width above 0), and "
         "zero_ps within 1e12";
}

}  // namespace

Result<Hello> read_hello(ByteView payload) {
  if (payload.size() > max_hello_bytes) return fault("it has more than 64 KiB");
  const json given = json::parse(payload.begin(), payload.end(), nullptr, false);
  if (!given.is_object()) return fault("expected a JSON object with model, serial and firmware");
  Hello out;
  for (const auto& [key, text] : {std::pair{"model", &out.model},
                                  {"serial", &out.serial},
                                  {"firmware", &out.firmware},
                                  {"sends", &out.sends}}) {
    const auto value = given.find(key);
    if (value == given.end()) continue;
    if (!value->is_string()) return fault(std::string("\"") + key + "\" is not a string");
    *text = value->get<std::string>();
  }
  const auto zones = given.find("zones");
  if (zones == given.end()) return out;
  if (!zones->is_array() || zones->size() > max_zones)
    return fault("\"zones\" is not a list of at most " + std::to_string(max_zones) + " zones");
  for (const json& entry : *zones)
    if (const std::string why = take_zone(entry, out.zones.emplace_back()); !why.empty())
      return fault("zone " + std::to_string(out.zones.size() - 1) + " " + why);
  return out;
}

}  // namespace echofuse::bridge

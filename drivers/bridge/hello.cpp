// SPDX-License-Identifier: MIT
#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "drivers/bridge/bridge_protocol.hpp"

namespace echofuse::bridge {
namespace {

constexpr int deepest = 8;
constexpr int max_values = 1024;

// SAX handler that stores only the known strings and zones, so that other content uses no memory.
class HelloReader final : public nlohmann::json_sax<nlohmann::json> {
 public:
  Hello hello;

  bool key(string_t& name) override {
    text_ = nullptr, number_ = nullptr;
    if (in_zones_ && depth_ == 3) number_ = number_of(hello.zones.back(), name);
    if (depth_ != 1) return true;
    wants_zones_ = name == "zones";
    if (name == "model") text_ = &hello.model;
    if (name == "serial") text_ = &hello.serial;
    if (name == "firmware") text_ = &hello.firmware;
    if (name == "sends") text_ = &hello.sends;
    return true;
  }
  bool string(string_t& value) override {
    if (number_ || wants_zones_ || is_in_list() || !count()) return false;
    if (text_) *text_ = value;
    text_ = nullptr;
    return true;
  }
  // Accepts the top-level object, objects in the list of zones, and values of unknown keys.
  bool start_object(std::size_t) override {
    const bool zone = is_in_list() && hello.zones.size() < max_zones && count();
    if (zone) hello.zones.emplace_back();
    return (depth_ == 0 || zone || other()) && ++depth_ <= deepest;
  }
  bool end_object() override { return leave(); }
  bool start_array(std::size_t) override {
    in_zones_ = in_zones_ || wants_zones_;
    return (std::exchange(wants_zones_, false) || other()) && ++depth_ <= deepest;
  }
  bool end_array() override {
    in_zones_ = in_zones_ && depth_ > 2;
    return leave();
  }
  bool null() override { return other(); }
  bool boolean(bool) override { return other(); }
  bool number_integer(number_integer_t value) override {
    return number(static_cast<double>(value));
  }
  bool number_unsigned(number_unsigned_t value) override {
    return number(static_cast<double>(value));
  }
  bool number_float(number_float_t value, const string_t&) override { return number(value); }
  bool binary(binary_t&) override { return other(); }
  bool parse_error(std::size_t, const std::string&, const nlohmann::json::exception&) override {
    return false;
  }

 private:
  bool count() { return depth_ > 0 && ++values_ <= max_values; }
  bool is_in_list() const { return in_zones_ && depth_ == 2; }
  static double* number_of(Zone& zone, const string_t& name) {
    if (name == "x") return &zone.x;
    if (name == "y") return &zone.y;
    if (name == "width") return &zone.width;
    return name == "zero_ps" ? &zone.zero_ps : nullptr;
  }
  bool number(double value) {
    if (!number_) return other();
    *std::exchange(number_, nullptr) = value;
    return count();
  }
  // Handles null, a boolean, or a value of an unknown key. Returns false if a string, a number or a
  // zone is expected.
  bool other() { return !text_ && !number_ && !wants_zones_ && !is_in_list() && count(); }
  bool leave() {
    --depth_;
    return true;
  }

  std::string* text_ = nullptr;  // receives the value that follows the key; null for unknown keys
  double* number_ = nullptr;
  bool wants_zones_ = false, in_zones_ = false;
  int depth_ = 0, values_ = 0;
};

}  // namespace

std::optional<Hello> read_hello(ByteView payload) {
  HelloReader reader;
  if (payload.size() > max_hello_bytes ||
      !nlohmann::json::sax_parse(payload.begin(), payload.end(), &reader) ||
      !std::ranges::all_of(reader.hello.zones, &Zone::plausible))
    return std::nullopt;
  return reader.hello;
}

}  // namespace echofuse::bridge

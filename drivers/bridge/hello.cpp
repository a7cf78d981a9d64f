// SPDX-License-Identifier: MIT
#include <nlohmann/json.hpp>
#include <string>

#include "drivers/bridge/bridge_protocol.hpp"

namespace echofuse::bridge {
namespace {

constexpr int deepest = 8;
constexpr int most_values = 1024;

// Keeps four texts and no tree: what else a hello holds costs nothing but its own bytes.
class HelloReader final : public nlohmann::json_sax<nlohmann::json> {
 public:
  Hello hello;

  bool key(string_t& name) override {
    text_ = nullptr;
    if (depth_ != 1) return true;
    if (name == "model") text_ = &hello.model;
    if (name == "serial") text_ = &hello.serial;
    if (name == "firmware") text_ = &hello.firmware;
    if (name == "sends") text_ = &hello.sends;
    return true;
  }
  bool string(string_t& value) override {
    if (!count()) return false;
    if (text_) *text_ = value;
    text_ = nullptr;
    return true;
  }
  // The outermost value is an object.
  bool start_object(std::size_t) override {
    return (depth_ == 0 || other()) && ++depth_ <= deepest;
  }
  bool end_object() override { return leave(); }
  bool start_array(std::size_t) override { return other() && ++depth_ <= deepest; }
  bool end_array() override { return leave(); }
  bool null() override { return other(); }
  bool boolean(bool) override { return other(); }
  bool number_integer(number_integer_t) override { return other(); }
  bool number_unsigned(number_unsigned_t) override { return other(); }
  bool number_float(number_float_t, const string_t&) override { return other(); }
  bool binary(binary_t&) override { return other(); }
  bool parse_error(std::size_t, const std::string&, const nlohmann::json::exception&) override {
    return false;
  }

 private:
  bool count() { return depth_ > 0 && ++values_ <= most_values; }
  // No text: false where one is expected.
  bool other() { return !text_ && count(); }
  bool leave() {
    --depth_;
    return true;
  }

  std::string* text_ = nullptr;  // target of the value after its key
  int depth_ = 0, values_ = 0;
};

}  // namespace

std::optional<Hello> read_hello(ByteView payload) {
  HelloReader reader;
  if (payload.size() > max_hello_bytes ||
      !nlohmann::json::sax_parse(payload.begin(), payload.end(), &reader))
    return std::nullopt;
  return reader.hello;
}

}  // namespace echofuse::bridge

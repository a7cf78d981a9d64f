// SPDX-License-Identifier: MIT
// A TOML configuration: refused with an Error, or values in their ranges that survive a round trip.
#include "drivers/core/settings.hpp"
#include "fuzz.hpp"

using namespace echofuse;
using namespace echofuse::fuzz;

namespace {

struct Values {
  double window_s = 3;
  std::int64_t bins = 336;
  bool on = false;
  std::string label, mode = "a";
  bool operator==(const Values&) const = default;
};

void bind(Settings& s, Values& v) {
  s.add("run.window_s", v.window_s, 0.05, 3600, "a number");
  s.add("run.label", v.label, "a text");
  s.add("run.mode", v.mode, "a choice", {"a", "b"});
  s.add("tdc.bins", v.bins, 1, 1 << 24, "a whole number");
  s.add("tdc.on", v.on, "a switch");
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Values values;
  Settings settings;
  bind(settings, values);
  try {
    settings.read_text(std::string(text_of({data, size})), "fuzz.toml");
  } catch (const Error& error) {
    require(error.code() == ExitCode::config && error.what()[0] != 0, "a config error says why");
    return 0;
  }
  require(values.window_s >= 0.05 && values.window_s <= 3600, "numbers lie in their range");
  require(values.bins >= 1 && values.bins <= 1 << 24, "whole numbers lie in their range");
  require(values.mode == "a" || values.mode == "b", "a choice is one of those");
  Values again;
  Settings second;
  bind(second, again);
  second.read_text(settings.resolved(true), "resolved.toml");
  require(again == values, "the resolved text gives the same values");
  return 0;
}

// SPDX-License-Identifier: MIT
// Input: a byte, then a string. If the byte is '=', the string is a key=value assignment of the
// command line. Otherwise, it is a settings file.
#include "drivers/util/settings.hpp"

#include "fuzz.hpp"

namespace {

struct Sample {
  double window_s = 3.0, offset = 0;
  std::int64_t bins = 336, seed = 0;
  bool filter = true;
  std::string address = "none", psf = "sinc";
  Settings settings{};

  Sample() {
    settings.add("window_s", window_s, 0.01, 3600, "slot length");
    settings.add("offset", offset, -1e300, 1e300, "any number");
    settings.add("tdc.bins", bins, 1, 65536, "number of bins");
    settings.add("tdc.seed", seed, INT64_MIN, INT64_MAX, "any integer");
    settings.add("tdc.filter", filter, "conditional filter");
    settings.add("tdc.address", address, "address of the tagger");
    settings.add("radar.psf", psf, "point spread function", {"sinc", "blackman"});
  }
  Sample(const Sample&) = delete;
  Sample& operator=(const Sample&) = delete;

  void check() const {
    require(window_s >= 0.01 && window_s <= 3600, "a number is in its range");
    require(offset >= -1e300 && offset <= 1e300, "an unlimited number is finite");
    require(bins >= 1 && bins <= 65536, "an integer is in its range");
    require(psf == "sinc" || psf == "blackman", "a text is one of the allowed ones");
  }
};

}  // namespace

void fuzz::run(ByteView input) {
  if (input.empty()) return;
  const std::string text(text_of(input.subspan(1)));
  const bool assignment = input[0] == '=';
  Sample sample;
  try {
    if (assignment)
      sample.settings.set(text);
    else
      sample.settings.read_text(text, "x.toml");
  } catch (const Error& error) {
    require(error.code() == ExitCode::config, "a fault has the code of a configuration");
    require_faults(error.what(), assignment ? "--set " : "x.toml:");
    return sample.check();
  }
  sample.check();

  Sample again;
  const std::string resolved = sample.settings.resolved(true);
  // An error here ends the target, because resolved settings must be readable.
  again.settings.read_text(resolved, "resolved");
  require(again.settings.resolved(true) == resolved, "resolved settings read back unchanged");
  Sample third;
  third.settings.read_text(sample.settings.with_origins(), "shown");
  require(third.settings.resolved(true) == resolved, "origins do not change values");
  require(again.bins == sample.bins && again.seed == sample.seed && again.psf == sample.psf &&
              again.filter == sample.filter && again.address == sample.address,
          "value by value");
}

// SPDX-License-Identifier: MIT
#include "drivers/core/settings.hpp"

#include <algorithm>
#include <catch2/catch.hpp>

using namespace echofuse;

namespace {

struct Sample {
  double window_s = 3.0;
  std::int64_t bins = 336;
  bool filter = true;
  std::string address = "none", psf = "sinc";
  Settings bound() {
    Settings s;
    s.add("window_s", window_s, 0.01, 3600, "slot length");
    s.add("tdc.bins", bins, 1, 65536, "number of bins");
    s.add("tdc.filter", filter, "conditional filter");
    s.add("tdc.address", address, "where the tagger is");
    s.add("radar.psf", psf, "point spread function", {"sinc", "blackman"});
    return s;
  }
};

std::string faults_of(const std::string& toml) {
  Sample sample;
  Settings s = sample.bound();
  try {
    s.read_text(toml, "lab.toml");
  } catch (const Error& e) {
    CHECK(e.code() == ExitCode::config);
    return e.what();
  }
  return {};
}

}  // namespace

TEST_CASE("values land in their fields; an integer is a number too") {
  Sample sample;
  Settings s = sample.bound();
  s.read_text("window_s = 2\n[tdc]\nbins = 8\nfilter = false\naddress = \"a\\\"b\"\n", "x");
  CHECK(sample.window_s == 2.0);
  CHECK(sample.bins == 8);
  CHECK_FALSE(sample.filter);
  CHECK(sample.address == "a\"b");
  CHECK(sample.psf == "sinc");
  CHECK(s.given("tdc.bins"));
  CHECK_FALSE(s.given("radar.psf"));
}

TEST_CASE("all faults come at once, each with its place and what would be right") {
  const std::string faults = faults_of(
      "windw_s = 3\nwindow_s = \"long\"\n[tdc]\nbins = 0\nfilter = 1\n[radar]\npsf = \"gauss\"\n");
  CHECK(
      faults.find("lab.toml:1:1: unknown key \"windw_s\"; the nearest known one is \"window_s\"") !=
      std::string::npos);
  CHECK(faults.find("lab.toml:2:1: window_s") != std::string::npos);
  CHECK(faults.find("a number from 0.01 to 3600") != std::string::npos);
  CHECK(faults.find(
            "lab.toml:4:1: tdc.bins = 0 does not fit; expected a whole number from 1 to 65536") !=
        std::string::npos);
  CHECK(faults.find("lab.toml:5:1: tdc.filter") != std::string::npos);
  CHECK(faults.find("one of \"sinc\" \"blackman\"") != std::string::npos);
  CHECK(std::count(faults.begin(), faults.end(), '\n') == 4);
}

TEST_CASE("a section given as a value, and text that is not TOML, are faults with a place") {
  CHECK(faults_of("tdc = 3\n").find("lab.toml:1:1: unknown key \"tdc\"") == 0);
  CHECK(faults_of("window_s = = 3\n").find("lab.toml:1:") == 0);
  CHECK(faults_of("window_s = nan\n").find("expected a number") != std::string::npos);
}

TEST_CASE("an assignment (--set) takes TOML values and bare words, and nothing else") {
  Sample sample;
  Settings s = sample.bound();
  s.set("window_s=0.2");
  s.set("tdc.address=bridge:tcp://127.0.0.1:41110");
  s.set("radar.psf=blackman");
  s.set("tdc.filter=false");
  CHECK(sample.window_s == 0.2);
  CHECK(sample.address == "bridge:tcp://127.0.0.1:41110");
  CHECK(sample.psf == "blackman");
  CHECK_FALSE(sample.filter);
  CHECK_THROWS_WITH(s.set("windw_s=1"), Catch::Contains("nearest known one is \"window_s\""));
  CHECK_THROWS_WITH(s.set("tdc.bins=many"), Catch::Contains("whole number"));
  CHECK_THROWS_WITH(s.set("tdc.bins"), Catch::Contains("key=value"));
  CHECK_THROWS_WITH(s.set("window_s=1\ntdc = 2"), Catch::Contains("expected a number"));
  CHECK_THROWS_WITH(s.set("tdc.address=\xff"), Catch::EndsWith("expected UTF-8"));
}

TEST_CASE("a fault is one line whatever the file holds") {
  CHECK(faults_of("\"a\\nb\\u001b\" = 1\n") ==
        "lab.toml:1:1: unknown key \"a?b?\"; the nearest known one is \"tdc.bins\"");
}

TEST_CASE("resolved settings read back to the same values") {
  Sample sample;
  sample.window_s = 0.1 + 0.2;
  sample.address = "\n\tC:\\x \"y\" '''\x7f";
  const std::string text = sample.bound().resolved(true);
  Sample other;
  other.bound().read_text(text, "resolved");
  CHECK(other.window_s == Approx(sample.window_s).epsilon(1e-14));
  CHECK(other.address == sample.address);
  CHECK(other.bound().resolved() == sample.bound().resolved());
}

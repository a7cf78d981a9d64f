// SPDX-License-Identifier: MIT
#include "drivers/util/settings.hpp"

#include "../fixtures/error.hpp"

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
    s.add("tdc.address", address, "address of the tagger");
    s.add("radar.psf", psf, "point spread function", {"sinc", "blackman"});
    return s;
  }
};

std::string faults_of(const std::string& toml) {
  Sample sample;
  Settings s = sample.bound();
  return test::refusal_by([&] { s.read_text(toml, "lab.toml"); });
}

}  // namespace

TEST_CASE("settings are stored in the bound fields, and an integer is accepted as a real number") {
  Sample sample;
  Settings s = sample.bound();
  s.read_text("window_s = 2\n[tdc]\nbins = 8\nfilter = false\naddress = \"a\\\"b\"\n", "x");
  CHECK(std::tuple(sample.window_s, sample.bins, sample.filter, sample.address, sample.psf) ==
        std::tuple(2.0, 8, false, "a\"b", "sinc"));
  CHECK(s.given("tdc.bins"));
  CHECK_FALSE(s.given("radar.psf"));
}

TEST_CASE(
    "all settings errors are reported together, each with its position and the expected value") {
  std::string faults = faults_of(
      "windw_s = 3\nwindow_s = \"long\"\n[tdc]\nbins = 0\nfilter = 1\naddress = 7\n"
      "[radar]\npsf = \"gauss\"\n");
  std::ranges::replace(faults, '\'', '"');  // versions of toml++ differ in the quotes
  CHECK(faults ==
        "lab.toml:1:1: unknown key \"windw_s\"; the most similar known name is \"window_s\"\n"
        "lab.toml:2:1: window_s = \"long\" is not valid; expected a number from 0.01 to 3600\n"
        "lab.toml:4:1: tdc.bins = 0 is not valid; expected a whole number from 1 to 65536\n"
        "lab.toml:5:1: tdc.filter = 1 is not valid; expected true or false\n"
        "lab.toml:6:1: tdc.address = 7 is not valid; expected a quoted string\n"
        "lab.toml:8:1: radar.psf = \"gauss\" is not valid; expected one of \"sinc\" \"blackman\"");
}

TEST_CASE("only the first 20 settings errors are listed") {
  std::string text;
  for (int i = 0; i < 5000; ++i) text += "key_" + std::to_string(i) + " = 1\n";
  const std::string faults = faults_of(text);
  CHECK(std::ranges::count(faults, '\n') == 20);
  CHECK(faults.ends_with("there are more errors; the list ends after the first 20"));
}

TEST_CASE("a section given as a value, or text that is not TOML, is reported with its position") {
  const auto [toml, start, fault] = GENERATE(table<std::string, std::string, std::string>(
      {{"tdc = 3\n", "1:1: ", "tdc is a section; expected [tdc] and its keys below"},
       {"[[radar]]\n", "1:3: ", "radar is a section"},
       {"[tcd]\nbins = 3\n", "1:2: ", "unknown section \"tcd\"; the most similar known name is"},
       {"window_s = = 3\n", "1:", "not TOML"},
       {"window_s = nan\n", "1:1: ", "expected a number"},
       {"\"a\\nb\\u001b\" = 1\n", "1:1: ", "unknown key \"a\\nb\\x1b\"; no similar name"},
       {"window_s = 3\nwindow_s = 4\n", "2:12: not TOML: ", "redefine"},
       {"[tdc]\nbins = 3\n[tdc]\n", "3:", "not TOML"},
       // After an invalid section header, the keys that follow are not checked, because their
       // section is unknown.
       {"[tdc\nbins = 0\n", "1:", "not TOML"},
       // A single fault that spans several lines is reported only once.
       {"[tdc]\naddress = \"\"\"open\nbins = 3\n", "", "not TOML"},
       {"[tdc]\nbins =\n3\nfilter = true\n", "", "not TOML"},
       {"window_s = [1 2,\n3\n]\n[tdc]\nbins = 3\n", "", "not TOML"}}));
  CHECK_THAT(faults_of(toml), Catch::StartsWith("lab.toml:" + start) && Catch::Contains(fault) &&
                                  !Catch::Contains("\n"));
}

TEST_CASE("invalid TOML lines do not hide later errors") {
  const std::string faults = faults_of(
      "window_s = = 3\n[tdc]\naddress = \"open\nbins = 8\nbins = 9\nfilter = 1\n"
      "[radar]\nspf = 1\n");
  std::string lines;
  for (std::size_t at = 0; at != faults.npos; at = faults.find("lab.toml", at + 1))
    lines += faults.at(at + std::string("lab.toml:").size());
  CHECK(lines == "13568");
  std::string many(1000, '=');
  for (int k = 0; k < 100; ++k) many += "\n= 1";
  CHECK(std::ranges::count(faults_of(many), '\n') == 19);
}

TEST_CASE("option --set accepts only TOML values and bare words") {
  Sample sample;
  Settings s = sample.bound();
  for (const char* setting : {"window_s=0.2", "radar.psf=blackman", "tdc.filter=false"})
    s.set(setting);
  CHECK(std::tuple(sample.window_s, sample.psf, sample.filter) ==
        std::tuple(0.2, "blackman", false));
  for (const std::string text : {"8", "1.50", "true", "1,20", "bridge:tcp://127.0.0.1:41110"}) {
    s.set("tdc.address=" + text);
    CHECK(sample.address == text);
  }
  const auto [setting, fault] = GENERATE(
      table<std::string, std::string>({{"tdc.address=[8]", "expected a quoted string"},
                                       {"windw_s=1", "most similar known name is \"window_s\""},
                                       {"win=1", "most similar known name is \"window_s\""},
                                       {"tdc.bins=many", "whole number"},
                                       {"tdc.bins", "key=value"},
                                       {"window_s=1\ntdc = 2", "expected a number"},
                                       {"tdc.address=\xff", "expected UTF-8"}}));
  CHECK_THROWS_WITH(s.set(setting), Catch::Contains(fault));
}

TEST_CASE("printed settings are read back with the same values") {
  Sample sample, other;
  sample.window_s = 0.1 + 0.2;
  sample.address = "\n\tC:\\x \"y\" '''\x7f";
  other.bound().read_text(sample.bound().resolved(true), "resolved");
  CHECK(other.window_s == Approx(sample.window_s).epsilon(1e-14));
  CHECK(other.address == sample.address);
  CHECK(other.bound().resolved() == sample.bound().resolved());
}

TEST_CASE("option --set overrides the configuration file, and errors in both are reported") {
  Sample sample;
  Settings s = sample.bound();
  CHECK(s.read("window_s = 1\n[tdc]\nbins = 0\n", "lab.toml", {"window_s=2", "tdc.bin=3", "x"}) ==
        std::vector<std::string>{
            "lab.toml:3:1: tdc.bins = 0 is not valid; expected a whole number from 1 to 65536",
            "--set tdc.bin=3: unknown key; the most similar known name is \"tdc.bins\"",
            "--set x: expected key=value"});
  CHECK(sample.window_s == 2);
}

TEST_CASE("the origin of each setting is printed as a comment in valid TOML") {
  Sample sample, other;
  Settings s = sample.bound();
  // A file name with a line break cannot inject settings.
  REQUIRE(s.read("window_s = 1\n[tdc]\nbins = 7\n", "a\nwindow_s = 5\n", {"radar.psf=blackman"})
              .empty());
  CHECK(s.origin("window_s") == "a\nwindow_s = 5\n:1:1");
  CHECK(s.origin("radar.psf") == "--set radar.psf=blackman");
  CHECK(s.origin("tdc.filter").empty());
  s.set("tdc.bins=8");
  const std::string text = s.with_origins();
  CHECK_THAT(text, Catch::Contains("\nwindow_s = 1.0  # a\\nwindow_s = 5\\n:1:1\n") &&
                       Catch::Contains("\nbins = 8  # --set tdc.bins=8\n") &&
                       Catch::Contains("\nfilter = true  # default\n") &&
                       Catch::Contains("# number of bins (a whole number from 1 to 65536)\n"));
  other.bound().read_text(text, "shown");
  CHECK(other.bound().resolved() == s.resolved());
}

TEST_CASE("a settings section is printed once, whatever the order in which its keys are bound") {
  std::int64_t n[] = {1, 2, 3, 4, 5};
  const auto bound = [&] {
    Settings s;
    const char* keys[] = {"a.x", "b.x", "plain", "a.y", "b.y"};
    for (std::size_t k = 0; k < 5; ++k) s.add(keys[k], n[k], 0, 9, "");
    return s;
  };
  const std::string text = bound().resolved();
  CHECK(text == "plain = 3\n\n[a]\nx = 1\ny = 4\n\n[b]\nx = 2\ny = 5\n");
  for (auto& v : n) v = 0;
  bound().read_text(text, "resolved");
  CHECK(n[3] == 4);
}

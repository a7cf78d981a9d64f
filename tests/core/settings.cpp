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
  CHECK(sample.window_s == 2.0);
  CHECK(sample.bins == 8);
  CHECK_FALSE(sample.filter);
  CHECK(sample.address == "a\"b");
  CHECK(sample.psf == "sinc");
  CHECK(s.given("tdc.bins"));
  CHECK_FALSE(s.given("radar.psf"));
}

TEST_CASE(
    "all settings errors are reported together, each with its position and the expected value") {
  const std::string faults = faults_of(
      "windw_s = 3\nwindow_s = \"long\"\n[tdc]\nbins = 0\nfilter = 1\n[radar]\npsf = \"gauss\"\n");
  for (const char* part :
       {"lab.toml:1:1: unknown key \"windw_s\"; the most similar known name is \"window_s\"",
        "lab.toml:2:1: window_s", "a number from 0.01 to 3600",
        "lab.toml:4:1: tdc.bins = 0 is not valid; expected a whole number from 1 to 65536",
        "lab.toml:5:1: tdc.filter", "one of \"sinc\" \"blackman\""})
    CHECK_THAT(faults, Catch::Contains(part));
  CHECK(std::count(faults.begin(), faults.end(), '\n') == 4);
}

TEST_CASE("only the first 20 settings errors are listed") {
  std::string text;
  for (int i = 0; i < 5000; ++i) text += "key_" + std::to_string(i) + " = 1\n";
  const std::string faults = faults_of(text);
  CHECK(std::count(faults.begin(), faults.end(), '\n') == 20);
  CHECK(faults.ends_with("there are more errors; the list ends after the first 20"));
}

TEST_CASE("a section given as a value, or text that is not TOML, is reported with its position") {
  CHECK(faults_of("tdc = 3\n") ==
        "lab.toml:1:1: tdc is a section; expected [tdc] and its keys below");
  CHECK(faults_of("[[radar]]\n").find("lab.toml:1:3: radar is a section") == 0);
  CHECK(faults_of("[tcd]\nbins = 3\n") ==
        "lab.toml:1:2: unknown section \"tcd\"; the most similar known name is \"tdc\"");
  CHECK(faults_of("window_s = = 3\n").find("lab.toml:1:") == 0);
  CHECK(faults_of("window_s = nan\n").find("expected a number") != std::string::npos);
}

TEST_CASE("option --set accepts only TOML values and bare words") {
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
  for (const char* text : {"8", "1.50", "true", "1,20"}) {
    s.set(std::string("tdc.address=") + text);
    CHECK(sample.address == text);
  }
  CHECK_THROWS_WITH(s.set("tdc.address=[8]"), Catch::Contains("expected a quoted string"));
  CHECK_THROWS_WITH(s.set("windw_s=1"), Catch::Contains("most similar known name is \"window_s\""));
  CHECK_THROWS_WITH(s.set("win=1"), Catch::Contains("most similar known name is \"window_s\""));
  CHECK_THROWS_WITH(s.set("tdc.bins=many"), Catch::Contains("whole number"));
  CHECK_THROWS_WITH(s.set("tdc.bins"), Catch::Contains("key=value"));
  CHECK_THROWS_WITH(s.set("window_s=1\ntdc = 2"), Catch::Contains("expected a number"));
  CHECK_THROWS_WITH(s.set("tdc.address=\xff"), Catch::EndsWith("expected UTF-8"));
}

TEST_CASE("a settings error is reported in a single line, whatever the file contains") {
  CHECK(faults_of("\"a\\nb\\u001b\" = 1\n") ==
        "lab.toml:1:1: unknown key \"a\\nb\\x1b\"; no similar name");
}

TEST_CASE("printed settings are read back with the same values") {
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

TEST_CASE("invalid TOML lines and repeated keys do not hide later errors") {
  const std::string twice = faults_of("window_s = 3\nwindow_s = 4\n");
  CHECK(twice.starts_with("lab.toml:2:12: not TOML: "));
  CHECK(twice.find("redefine") != std::string::npos);
  const std::string faults = faults_of(
      "window_s = = 3\n[tdc]\naddress = \"open\nbins = 8\nbins = 9\nfilter = 1\n"
      "[radar]\nspf = 1\n");
  std::vector<std::string> places;
  for (std::size_t at = 0; at != faults.npos; at = faults.find("lab.toml", at + 1))
    places.push_back(faults.substr(at, std::string("lab.toml:N").size()));
  CHECK(places == std::vector<std::string>{"lab.toml:1", "lab.toml:3", "lab.toml:5", "lab.toml:6",
                                           "lab.toml:8"});
  // A single fault that spans several lines is reported only once.
  for (const char* text :
       {"[tdc]\naddress = \"\"\"open\nbins = 3\n", "[tdc]\nbins =\n3\nfilter = true\n",
        "window_s = [1 2,\n3\n]\n[tdc]\nbins = 3\n"}) {
    CAPTURE(text);
    CHECK(faults_of(text).find('\n') == std::string::npos);
    CHECK(faults_of(text).find("not TOML") != std::string::npos);
  }
  // After an invalid section header, the keys that follow are not checked, because their section is
  // unknown.
  CHECK(faults_of("[tdc\nbins = 0\n").find('\n') == std::string::npos);
  CHECK(faults_of("[tdc]\nbins = 3\n[tdc]\n").find("lab.toml:3:") == 0);
  std::string lines(1000, '=');
  for (int k = 0; k < 100; ++k) lines += "\n= 1";
  const std::string many = faults_of(lines);
  CHECK(std::count(many.begin(), many.end(), '\n') == 19);
}

TEST_CASE("option --set overrides the configuration file, and errors in both are reported") {
  Sample sample;
  Settings s = sample.bound();
  const auto faults =
      s.read("window_s = 1\n[tdc]\nbins = 0\n", "lab.toml", {"window_s=2", "tdc.bin=3", "x"});
  REQUIRE(faults.size() == 3);
  CHECK(faults[0].find("lab.toml:3:1: tdc.bins = 0") == 0);
  CHECK(faults[1] == "--set tdc.bin=3: unknown key; the most similar known name is \"tdc.bins\"");
  CHECK(faults[2] == "--set x: expected key=value");
  CHECK(sample.window_s == 2);
}

TEST_CASE("the origin of each setting is printed as a comment in valid TOML") {
  Sample sample;
  Settings s = sample.bound();
  REQUIRE(s.read("window_s = 1\n[tdc]\nbins = 7\n", "lab.toml", {"radar.psf=blackman"}).empty());
  CHECK(s.origin("window_s") == "lab.toml:1:1");
  CHECK(s.origin("tdc.bins") == "lab.toml:3:1");
  CHECK(s.origin("radar.psf") == "--set radar.psf=blackman");
  CHECK(s.origin("tdc.filter").empty());
  s.set("tdc.bins=8");
  CHECK(s.origin("tdc.bins") == "--set tdc.bins=8");
  const std::string text = s.with_origins();
  CHECK(text.find("\nwindow_s = 1.0  # lab.toml:1:1\n") != std::string::npos);
  CHECK(text.find("\nbins = 8  # --set tdc.bins=8\n") != std::string::npos);
  CHECK(text.find("\nfilter = true  # default\n") != std::string::npos);
  CHECK(text.find("# number of bins (a whole number from 1 to 65536)\n") != std::string::npos);
  Sample other;
  other.bound().read_text(text, "shown");
  CHECK(other.bound().resolved() == s.resolved());
}

TEST_CASE("a file name with a line break cannot inject settings") {
  Sample sample;
  Settings s = sample.bound();
  REQUIRE(s.read("window_s = 1\n", "a\nwindow_s = 5\n", {}).empty());
  Sample other;
  other.bound().read_text(s.with_origins(), "shown");
  CHECK(other.window_s == 1);
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

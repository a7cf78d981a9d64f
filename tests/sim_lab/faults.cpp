// SPDX-License-Identifier: MIT
#include "sim/devices/faults.hpp"

#include "../fixtures/error.hpp"
#include "../fixtures/shell.hpp"
#include "lab_thread.hpp"

using namespace echofuse::sim;
using test::has;

namespace {

std::string complaint(const std::string& text) {
  return test::refusal_by([&] { read_faults(text, "f.toml"); });
}

const std::string good = "[[fault]]\ndevice = \"tdc\"\nkind = \"drop\"\nat_s = 1\nfor_s = 0.5\n";

}  // namespace

TEST_CASE("the parser reads all fields of a faults file") {
  const auto faults = read_faults(good + R"(every_s = 4
[[fault]]
device = "depth"
kind = "late"
at_s = 2
for_s = 3
amount = 0.25
)",
                                  "f.toml");
  REQUIRE(faults.size() == 2);
  CHECK(faults[0].device == "tdc");
  CHECK(faults[0].kind == FaultKind::drop);
  CHECK(faults[0].every_s == 4);
  // By default, the fault drops all data.
  CHECK(faults[0].amount == 1);
  CHECK(faults[1].kind == FaultKind::late);
  CHECK(faults[1].amount == 0.25);
  CHECK(read_faults("", "empty").empty());
}

TEST_CASE("all errors of a faults file are reported with line and column") {
  CHECK(has(complaint("[[fault"), "f.toml:1:"));
  CHECK(complaint("x = 1\n") == "f.toml:1:5: x: expected [[fault]] tables only");
  CHECK(complaint(good + "colour = 3\n") ==
        "f.toml:6:10: colour: unknown key; expected device, at_s, for_s, every_s, kind, amount");
  const std::string all = complaint(R"([[fault]]
device = "laser"
kind = "stall"
at_s = "now"
for_s = -1
amount = 3
)");
  CHECK(has(all, "f.toml:2:10: device: expected one of tdc, radar, depth"));
  CHECK(has(all, "f.toml:4:8: at_s: expected a number from 0 to 1e+07"));
  CHECK(has(all, "f.toml:5:9: for_s: expected a number"));
  CHECK(has(all, "f.toml:6:10: stall takes no amount"));
  CHECK(has(complaint("[[fault]]\ndevice = \"tdc\"\nkind = \"loud\"\n"),
            "f.toml:3:8: kind: expected one of drop,"));
  CHECK(has(complaint(good + "every_s = 0.4\n"), "overlap"));
  CHECK(has(complaint(good + "amount = 1.5\n"), "amount: expected a number from 0 to 1"));
  CHECK(has(complaint("[[fault]]\ndevice = \"depth\"\nkind = \"gain\"\nat_s = 1\nfor_s = 1\n"),
            "a depth camera has no gain"));
  CHECK(has(complaint("[[fault]]\ndevice = \"tdc\"\nkind = \"freeze\"\nat_s = 1\nfor_s = 1\n"),
            "a time tagger has no frame to freeze"));
}

TEST_CASE("a simulated fault affects only the specified device and only at the specified times") {
  const Faults faults(
      {{"tdc", FaultKind::drop, 1, 0.5, 4, 0.3}, {"radar", FaultKind::stall, 0, 9, 0, 0}}, "tdc");
  for (const double t : {1.0, 1.4, 5.0, 9.4}) CHECK(faults.at(FaultKind::drop, t) == 0.3);
  for (const double t : {0.0, 0.9, 1.5, 4.9, 5.5}) CHECK_FALSE(faults.at(FaultKind::drop, t));
  CHECK_FALSE(faults.at(FaultKind::stall, 1));
  CHECK(Faults({}, "tdc").empty());

  // The change at 1 s is excluded, because the interval does not include its start.
  const auto changes = faults.changes(1, 9.2);
  REQUIRE(changes.size() == 4);
  const double times[] = {1.5, 5, 5.5, 9};
  for (std::size_t i = 0; i < 4; ++i) {
    CHECK(changes[i].time_s == times[i]);
    CHECK(changes[i].begins == (i % 2 == 1));
  }
}

TEST_CASE("a clock offset ends with the fault, but the error from a clock drift remains") {
  const Faults faults({{"tdc", FaultKind::clock_offset, 10, 1, 0, -0.5},
                       {"tdc", FaultKind::clock_drift, 2, 3, 20, 200}},
                      "tdc");
  CHECK(faults.clock_error_s(1) == 0);
  CHECK(faults.clock_error_s(3) == Approx(200e-6));
  CHECK(faults.clock_error_s(6) == Approx(600e-6));
  CHECK(faults.clock_error_s(10.5) == Approx(600e-6 - 0.5));
  CHECK(faults.clock_error_s(11) == Approx(600e-6));
  CHECK(faults.clock_error_s(24) == Approx(1000e-6));
}

TEST_CASE("the simulated laboratory refuses an invalid faults file and an unwritable log") {
  test::Folder place;
  std::ofstream(place / "f.toml") << "[[fault]]\n";
  port::SystemLoop loop;
  LabOptions options = test::options_in(place);
  options.faults = place / "f.toml";
  CHECK_THROWS_AS(Lab(loop, options), Error);
  options.faults = "";
  options.log = place / "nowhere/log";
  CHECK_THROWS_AS(Lab(loop, options), Error);
}

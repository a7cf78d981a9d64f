// SPDX-License-Identifier: MIT
#include "sim/devices/faults.hpp"

#include "../fixtures/error.hpp"
#include "lab_thread.hpp"

using namespace echofuse::sim;

namespace {

using FaultTuple = std::tuple<std::string, FaultKind, double, double, double, double>;
std::vector<FaultTuple> as_tuples(const std::vector<Fault>& faults) {
  std::vector<FaultTuple> out;
  for (const Fault& f : faults)
    out.emplace_back(f.device, f.kind, f.at_s, f.for_s, f.every_s, f.amount);
  return out;
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
  // By default, a fault drops all data.
  CHECK(as_tuples(faults) == std::vector<FaultTuple>{{"tdc", FaultKind::drop, 1, 0.5, 4, 1},
                                                     {"depth", FaultKind::late, 2, 3, 0, 0.25}});
  CHECK(read_faults("", "empty").empty());
}

TEST_CASE("all errors of a faults file are reported with line and column") {
  const auto fault = [](const char* device, const char* kind) {
    return "[[fault]]\ndevice = \"" + std::string(device) + "\"\nkind = \"" + kind +
           "\"\nat_s = 1\nfor_s = 1\n";
  };
  const std::string many = R"([[fault]]
device = "laser"
kind = "stall"
at_s = "now"
for_s = -1
amount = 3
)";
  for (const auto& [text, why] :
       {std::pair<std::string, std::string>{"[[fault", "f.toml:1:"},
        {"x = 1\n", "f.toml:1:5: x: expected [[fault]] tables only"},
        {good + "colour = 3\n",
         "f.toml:6:10: colour: unknown key; expected device, at_s, for_s, "
         "every_s, kind, amount"},
        {many, "f.toml:2:10: device: expected one of tdc, radar, depth"},
        {many, "f.toml:4:8: at_s: expected a number from 0 to 1e+07"},
        {many, "f.toml:5:9: for_s: expected a number"},
        {many, "f.toml:6:10: stall takes no amount"},
        {fault("tdc", "loud"), "f.toml:3:8: kind: expected one of drop,"},
        {good + "every_s = 0.4\n", "overlap"},
        {good + "amount = 1.5\n", "amount: expected a number from 0 to 1"},
        {fault("depth", "gain"), "a depth camera has no gain"},
        {fault("tdc", "freeze"), "a time tagger has no frame to freeze"}})
    test::check_error(ExitCode::config, why, [&, input = text] { read_faults(input, "f.toml"); });
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
  std::vector<std::pair<double, bool>> found;
  for (const auto& change : changes) found.emplace_back(change.time_s, change.begins);
  CHECK(found ==
        std::vector<std::pair<double, bool>>{{1.5, false}, {5, true}, {5.5, false}, {9, true}});
}

TEST_CASE("a clock offset ends with the fault, but the error from a clock drift remains") {
  const Faults faults({{"tdc", FaultKind::clock_offset, 10, 1, 0, -0.5},
                       {"tdc", FaultKind::clock_drift, 2, 3, 20, 200}},
                      "tdc");
  for (const auto& [time_s, error_s] : {std::pair{1., 0.},
                                        {2, 0},
                                        {3, 200e-6},
                                        {6, 600e-6},
                                        {10, 600e-6 - 0.5},
                                        {10.5, 600e-6 - 0.5},
                                        {11, 600e-6},
                                        {24, 1000e-6},
                                        {30, 1200e-6}}) {
    CAPTURE(time_s);
    CHECK(faults.clock_error_s(time_s) == Approx(error_s).margin(1e-12));
  }
}

TEST_CASE("the simulated laboratory refuses an invalid faults file and an unwritable log") {
  const test::Folder place;
  std::ofstream(place / "f.toml") << "[[fault]]\n";
  port::SystemLoop loop;
  LabOptions options = test::options_in(place);
  options.faults = place / "f.toml";
  CHECK_THROWS_AS(Lab(loop, options), Error);
  options.faults = "";
  options.log = place / "nowhere/log";
  CHECK_THROWS_AS(Lab(loop, options), Error);
}

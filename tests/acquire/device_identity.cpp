// SPDX-License-Identifier: MIT
#include "../catch.hpp"
#include "acquire/devices/devices.hpp"
#include "drivers/bridge/bridge_writer.hpp"
#include "drivers/port/virtual_loop.hpp"

using namespace echofuse::acquire;
using namespace std::chrono_literals;

namespace {

// Simulates a bridge that closes its connection after one second.
class ShortBridge final : public port::BytePort {
 public:
  ShortBridge(port::Loop& loop, const std::string& serial)
      : timer_(loop),
        hello_(bridge::make_block(bridge::BlockKind::hello, 0, 0,
                                  bridge::hello_payload({.sensor = Sensor::spd,
                                                         .address = "",
                                                         .model = "Tagger",
                                                         .serial = serial,
                                                         .firmware = "1",
                                                         .axes = {}}))) {}
  void open(port::PortHandlers handlers) override {
    handlers_ = std::move(handlers);
    timer_.after(1ms, [this] {
      handlers_.opened();
      handlers_.bytes(hello_);
      timer_.after(1s, [this] {
        handlers_.gone({std::make_error_code(std::errc::connection_reset), "closed"});
      });
    });
  }
  void write(ByteView) override {}

 private:
  port::Timer timer_;
  Bytes hello_;
  port::PortHandlers handlers_;
};

struct Warnings final : SampleSink {
  void on_event(Sensor, Severity severity, const std::string& text) override {
    if (severity == Severity::warning && text.find("calibrat") != text.npos) texts.push_back(text);
  }
  std::vector<std::string> texts;
};

}  // namespace

TEST_CASE("a calibration that is too old or belongs to another device causes a warning") {
  struct Row {
    int age_days;
    std::vector<const char*> serials;  // at the calibration, and at each connection
    std::string warning;
  };
  const std::string other = "T2, previously T1: the calibration may belong to another device";
  const auto [age_days, serials, warning] =
      GENERATE_COPY(Row{89, {"T1", "T2"}, other}, Row{89, {"T1", "T1", "T1", "T2", "T2"}, other},
                    Row{89, {"", "T1", "T2", "T2"}, other},
                    Row{91, {"T2", "T2"}, "older than 90 days; calibrate again"});
  CAPTURE(age_days, serials);
  port::VirtualLoop loop(std::chrono::hours(24 * 365 * 56));
  Config config;
  config.tdc.address = "bridge:tcp://tagger:1";
  const std::string date = iso8601(loop.utc() - std::chrono::hours(24 * age_days));
  config.calibration.entries = {
      {.sensor = Sensor::spd, .date_utc = date, .method = "m", .serial = serials[0]}};
  std::size_t connections = 0;
  loop.ports[config.tdc.address] = [&] {
    connections = std::min(connections + 1, serials.size() - 1);
    return std::make_unique<ShortBridge>(loop, serials[connections]);
  };
  Warnings warnings;
  Devices devices(loop, config, warnings);
  devices.start();
  loop.run_until([] { return false; }, loop.now() + 60s);
  devices.stop();
  CHECK(connections == serials.size() - 1);
  REQUIRE(warnings.texts.size() == 1);
  CHECK_THAT(warnings.texts[0], Catch::EndsWith(warning));
}

// SPDX-License-Identifier: MIT
#include <memory>

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
  port::VirtualLoop loop(std::chrono::hours(24 * 365 * 56));
  Config config;
  config.tdc.address = "bridge:tcp://tagger:1";
  config.calibration.entries = {{.sensor = Sensor::spd,
                                 .date_utc = iso8601(loop.utc() - std::chrono::hours(24 * 89)),
                                 .method = "m",
                                 .serial = "T1"}};
  loop.ports[config.tdc.address] = [&] { return std::make_unique<ShortBridge>(loop, "T2"); };
  Warnings warnings;
  const auto run = [&] {
    Devices devices(loop, config, warnings);
    devices.start();
    loop.run_until([] { return false; }, loop.now() + 5s);
    devices.stop();
  };
  run();
  CHECK(warnings.texts ==
        std::vector<std::string>{
            "time tagger T2, previously T1: the calibration may belong to another device"});
  config.calibration.entries[0].date_utc = iso8601(loop.utc() - std::chrono::hours(24 * 91));
  config.calibration.entries[0].serial = "T2";
  run();
  REQUIRE(warnings.texts.size() == 2);
  CHECK(warnings.texts[1].find("is older than 90 days; calibrate again") != std::string::npos);
}

TEST_CASE("a warning is reported if a different device reconnects at the same address") {
  port::VirtualLoop loop;
  Config config;
  config.tdc.address = "bridge:tcp://tagger:1";
  int connections = 0;
  loop.ports[config.tdc.address] = [&] {
    const char* serials[] = {"T1", "T1", "T2", "T2"};
    return std::make_unique<ShortBridge>(loop, serials[std::min(connections++, 3)]);
  };
  Warnings warnings;
  Devices devices(loop, config, warnings);
  devices.start();
  loop.run_until([&] { return connections == 5; }, loop.now() + 60s);
  devices.stop();
  CHECK(connections == 5);
  CHECK(warnings.texts ==
        std::vector<std::string>{
            "time tagger T2, previously T1: the calibration may belong to another device"});
}

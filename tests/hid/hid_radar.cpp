// SPDX-License-Identifier: MIT
// Tests the unmodified driver with simulated radar firmware behind two CP2110 chips.
#include "../drivers/hex.hpp"
#include "../drivers/sink.hpp"
#include "../fixtures/folder.hpp"
#include "bed.hpp"
#include "drivers/make_driver.hpp"
#include "sim/devices/radar_firmware.hpp"
#include "tests/emulation/hid_cp2110.hpp"

using test::run_until;

namespace {

// Radar board and radar driver that share one event loop.
struct Bench {
  Bench() {
    firmware.boot();
    const std::string cfg =
        test::contents(test::source_dir + "/config/radar/xwr68xx_paper_50cm.cfg");
    driver = make_radar(loop, {"hid:10c4:ea80:CLI", "hid:10c4:ea80:DATA", cfg, "paper.cfg"});
    driver->start(sink);
  }
  std::uint64_t count(const char* name) const { return test::counter(*driver, name); }
  bool counts(const char* name) {
    return run_until(loop, [&] { return count(name) == 1; });
  }
  // Sends a frame. Returns whether it arrives.
  bool delivers() {
    Bytes frame = test::read_golden("radar.hex")[2];
    frame[20] = ++number;
    data.receive(frame);
    return run_until(loop, [&] { return sink.radar.size() == number; });
  }
  auto reported(const std::string& start) const {
    return std::ranges::count_if(sink.events,
                                 [&](const std::string& text) { return text.starts_with(start); });
  }

  port::SystemLoop loop;
  sim::HidCp2110 data{test::bed(), {1, "DATA"}, [](ByteView) {}};
  sim::HidCp2110 cli{test::bed(), {0, "CLI"}, [this](ByteView bytes) {
                       loop.post([this, copy = Bytes(bytes.begin(), bytes.end())] {
                         firmware.receive(copy);
                         firmware.between_frames();
                       });
                     }};
  sim::RadarFirmware firmware{[this](const std::string& text) { cli.receive(test::view_of(text)); },
                              [](const std::string&) {}};
  std::uint8_t number = 0;
  test::KeepingSink sink;
  std::unique_ptr<Driver> driver;
};

}  // namespace

TEST_CASE("the cfg dialogue and radar frames work over two HID ports, even after a reconnection") {
  Bench b;
  REQUIRE(b.counts("configured"));
  for (int i = 0; i < 20; ++i) REQUIRE(b.delivers());
  CHECK(b.count("lost_frames") + b.count("junk_bytes") + b.count("port_losses") == 0);
  CHECK(b.reported("hid:10c4:ea80:DATA: 921600 baud") == 1);
  CHECK(b.reported("hid:") == 1);

  // A receive overrun is reported and counted, and the connection is kept.
  b.data.receive(Bytes(900, 0x55));
  REQUIRE(b.counts("port_losses"));
  CHECK(b.reported("hid:10c4:ea80:DATA: overrun: the bridge lost bytes") == 1);
  REQUIRE(b.delivers());
  CHECK(b.count("connections") == 1);

  b.data.unplug();
  REQUIRE(run_until(b.loop, [&] { return b.sink.state() == DeviceState::faulted; }));
  b.data.plug();
  REQUIRE(b.counts("restarted"));
  REQUIRE(b.delivers());
  CHECK(b.sink.state() == DeviceState::streaming);
}

// SPDX-License-Identifier: MIT
// Tests the radar driver over real pseudo-terminals with a minimal simulated firmware.
#include "../fixtures/folder.hpp"
#include "drivers/make_driver.hpp"
#include "hex.hpp"
#include "sim/devices/pty_uart.hpp"
#include "sink.hpp"

using test::run_until;

namespace {

const std::string cfg =
    "sensorStop\n"
    "flushCfg\n"
    "channelCfg 15 7 0\n"
    "profileCfg 0 60 7 3 24 0 0 166 1 256 12500 0 0 30\n"
    "chirpCfg 0 0 0 0 0 0 0 1\n"
    "frameCfg 0 0 32 0 100 1 0\n"
    "guiMonitor -1 0 1 0 0 0 1\n"
    "sensorStart\n";

struct Bench {
  void start(const std::string& text = cfg) {
    driver = make_radar(loop, {"serial:" + dir / "cli", "serial:" + dir / "data", text, "x.cfg"});
    driver->start(sink);
  }
  std::uint64_t count(const char* name) const { return test::counter(*driver, name); }

  test::Folder dir;
  port::SystemLoop loop;
  test::KeepingSink sink;
  std::unique_ptr<Driver> driver;
};

// Radar that accepts each command.
struct Board {
  explicit Board(Bench& b)
      : cli(b.loop, b.dir / "cli", 115200, [this](ByteView bytes) { receive(bytes); }),
        data(b.loop, b.dir / "data", 921600, [](ByteView) {}) {}
  void receive(ByteView bytes) {
    heard.append(bytes.begin(), bytes.end());
    for (auto n = std::ranges::count(bytes, '\n'); n > 0; --n)
      cli.send(test::view_of("mmWave SDK Version      : 03.05.00.04\n\rDone\n\rmmwDemo:/>"));
  }
  std::string heard;
  sim::PtyUart cli, data;
};

}  // namespace

TEST_CASE("the radar driver sends the cfg unchanged and then receives frames") {
  Bench b;
  Board board(b);
  // Bytes that were waiting before the port is opened are discarded.
  board.data.send(test::view_of("bytes of yesterday"));
  REQUIRE(run_until(b.loop, [&] { return board.data.idle(); }));
  b.start();
  REQUIRE(run_until(b.loop, [&] { return b.count("configured") == 1; }));
  CHECK(board.heard == "\nversion\n" + cfg);
  CHECK(b.sink.state() == DeviceState::connecting);
  const auto golden = test::read_golden("radar.hex");
  board.data.send(test::join(golden));
  REQUIRE(run_until(b.loop, [&] { return b.sink.radar.size() == 3; }));
  CHECK(b.sink.state() == DeviceState::streaming);
  CHECK(b.sink.info.firmware == "mmWave SDK 03.05.00.04");
  REQUIRE(b.sink.info.axes.size() == 1);
  CHECK(b.sink.info.axes[0].count == 256);
  CHECK(b.sink.info.axes[0].quantity == "power_with_noise");
  CHECK(b.sink.radar[2].frame_number == 213);
  CHECK(b.sink.radar[2].lost_before == 2);
  CHECK(b.count("junk_bytes") == 0);
  CHECK(b.count("lost_frames") == 2);
  b.driver->stop();
  board.data.send(golden[0]);
  const std::size_t calls = b.sink.calls();
  b.loop.run_for(std::chrono::milliseconds(50));
  CHECK(b.sink.calls() == calls);
}

TEST_CASE("a heat map of another board is dropped, but the range profile of the frame is kept") {
  Bench b;
  Board board(b);
  std::string text = cfg;
  for (const auto& [from, to] : std::vector<std::pair<std::string, std::string>>{
           {"256 12500", "4 12500"},
           {"frameCfg 0 0", "chirpCfg 1 1 0 0 0 0 0 4\nframeCfg 0 1"},
           {"-1 0 1 0 0 0 1", "-1 0 1 0 1 0 1"}})
    text.replace(text.find(from), from.size(), to);
  b.start(text);
  REQUIRE(run_until(b.loop, [&] { return b.count("configured") == 1; }));
  board.data.send(test::join(test::read_golden("radar_array.hex")));
  REQUIRE(run_until(b.loop, [&] { return b.sink.radar.size() == 4; }));
  REQUIRE(b.sink.info.axes.size() == 2);
  CHECK(same_axis(b.sink.info.axes[1],
                  Axis{"array", "covariance", "m", 4, 0, b.sink.info.axes[0].step, 8}));
  std::vector<std::size_t> values;
  for (const RadarFrame& frame : b.sink.radar)
    values.insert(values.end(), {frame.power.size(), frame.array.size()});
  CHECK(values == std::vector<std::size_t>{4, 64, 4, 0, 4, 64, 4, 0});
  CHECK(b.count("arrays") == 3);
  CHECK(b.count("bad_arrays") == 1);
  CHECK(b.sink.events == std::vector<std::string>{
                             "the heat map has 48 samples in TLV 8, but the cfg and radar.board "
                             "require 32 in TLV 4; the heat map is ignored"});
}

TEST_CASE("a missing radar port is reported with its name") {
  Bench b;
  b.start();
  REQUIRE(run_until(b.loop, [&] { return b.sink.state() == DeviceState::faulted; }));
  CHECK(b.sink.events.at(0) == b.dir / "cli" + ": cannot open: No such file or directory");
}

TEST_CASE("swapped radar ports are detected by their names when the driver starts") {
  const bool swapped = GENERATE(false, true);
  Bench b;
  const std::string by_id = "serial:/dev/serial/by-id/usb-Texas_Instruments_XDS110_R1-if0",
                    command = by_id + "0", data = by_id + "3";
  b.driver = make_radar(b.loop, {swapped ? data : command, swapped ? command : data, cfg, "x.cfg"});
  b.driver->start(b.sink);
  const std::string end = " port; are radar.cli and radar.data swapped?";
  CHECK(b.sink.events ==
        (swapped ? std::vector{"radar.cli = \"" + data + "\" is the board's data" + end,
                               "radar.data = \"" + command + "\" is the board's command" + end}
                 : std::vector<std::string>{}));
}

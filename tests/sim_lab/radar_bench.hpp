// SPDX-License-Identifier: MIT
// Connects the radar driver to simulated firmware by two wires in memory. Bytes arrive exactly as
// the test sends them, and are never lost by the wires.
#pragma once
#include <optional>

#include "../drivers/sink.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/paths.hpp"
#include "../fixtures/wire.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "drivers/radar/radar_driver.hpp"
#include "sim/devices/radar_firmware.hpp"
#include "sim/wire/encode.hpp"

namespace echofuse::test {

// Simulated radar board that executes sensorStop immediately and sends frames only on request.
class RadarBoard {
 public:
  explicit RadarBoard(port::Loop& loop)
      : cli(loop,
            [this](ByteView bytes) {
              for (const std::uint8_t byte : bytes) note(static_cast<char>(byte));
              firmware_->receive(bytes);
              firmware_->between_frames();
            }),
        data(loop, [](ByteView) {}) {
    power_up();
  }

  // Resets the board, so that it loses its configuration.
  void power_up() {
    firmware_.emplace([this](const std::string& text) { cli.send(text); },
                      [this](const std::string& raw) { data.send(raw); });
    number = 0;
    firmware_->boot();
  }
  void say(const std::string& text) { firmware_->say(text); }
  bool running() const { return firmware_->running().has_value(); }
  // Returns the next 256-byte frame, which contains 64 range bins, statistics and temperatures.
  Bytes frame() {
    ++number;
    std::vector<std::uint16_t> codes(64);
    for (std::size_t i = 0; i < codes.size(); ++i)
      codes[i] = static_cast<std::uint16_t>(3000 + number % 500 + i);
    return sim::radar_frame(
        {number, number * 10'000'000, 0},
        {sim::range_profile_tlv(codes), sim::stats_tlv({}), sim::temperature_tlv({})}, rng_);
  }
  // Returns the non-empty lines that the host has sent since the previous call.
  std::vector<std::string> heard() { return std::exchange(lines_, {}); }
  std::size_t lines_heard() const { return lines_.size(); }

  Wire cli, data;
  std::uint32_t number = 0;

 private:
  void note(char c) {
    if (c != '\n')
      line_ += c;
    else if (!line_.empty())
      lines_.push_back(std::exchange(line_, {}));
  }
  std::optional<sim::RadarFirmware> firmware_;
  std::string line_;
  std::vector<std::string> lines_;
  Rng rng_ = make_rng(1, 1);
};

struct RadarBench {
  explicit RadarBench(radar::RadarSetup with = {}) : board(loop), setup(std::move(with)) {
    setup.address = "test";
    setup.cli = board.cli.opener();
    setup.data = board.data.opener();
    setup.cfg_text = contents(source_dir + "/config/radar/xwr68xx_paper_50cm.cfg");
    setup.cfg_name = "x.cfg";
    for (const auto& line : radar::command_lines(setup.cfg_text)) whole_cfg.push_back(line.text);
    whole_cfg.insert(whole_cfg.begin(), "version");
    driver.emplace(loop, setup);
  }
  std::uint64_t count(const std::string& name) const { return counter(*driver, name); }
  std::size_t frames() const { return sink.radar.size(); }
  DeviceState state() const { return sink.state(); }
  // Sends a frame every 10 ms while the sensor is running, until the condition is true. Returns
  // false if the condition is still false after the time limit.
  template <class Condition>
  bool until(Condition condition, std::chrono::milliseconds limit = std::chrono::seconds(10)) {
    const auto end = loop.now() + limit;
    while (!condition()) {
      if (loop.now() > end) return false;
      if (board.running()) board.data.send(board.frame());
      run_until(loop, condition, std::chrono::milliseconds(10));
    }
    return true;
  }
  void start() {
    driver->start(sink);
    REQUIRE(until([&] { return frames() >= 3; }));
    CHECK(board.heard() == whole_cfg);
  }
  void plug(bool in) {
    board.cli.plug(in);
    board.data.plug(in);
  }
  // Returns the time until the next frame arrives, in s.
  double seconds_to_frame() {
    const std::size_t before = frames();
    const HostTime from = loop.now();
    REQUIRE(until([&] { return frames() > before; }));
    return seconds(loop.now() - from);
  }
  bool faulted() {
    return until([&] { return state() == DeviceState::faulted; });
  }
  bool reported(const std::string& beginning) const {
    return std::any_of(sink.events.begin(), sink.events.end(),
                       [&](const std::string& event) { return event.starts_with(beginning); });
  }
  // Checks that every frame after the first is either delivered or counted as lost.
  void check_all_accounted_for() const {
    std::uint32_t lost = 0;
    for (const RadarFrame& f : sink.radar) lost += f.lost_before;
    CHECK(sink.radar.front().frame_number + frames() - 1 + lost == sink.radar.back().frame_number);
  }

  port::VirtualLoop loop;
  RadarBoard board;
  radar::RadarSetup setup;
  KeepingSink sink;
  std::vector<std::string> whole_cfg;
  std::optional<radar::RadarDriver> driver;
};

}  // namespace echofuse::test

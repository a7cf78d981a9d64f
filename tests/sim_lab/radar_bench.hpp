// SPDX-License-Identifier: MIT
// The radar driver on two wires in memory, with the simulated firmware at their other end: every
// byte is where the test put it, and nothing is lost but what the test takes away.
#pragma once
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "../virtual/wire.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/port/loop.hpp"
#include "drivers/radar/radar_driver.hpp"
#include "sim/devices/radar_firmware.hpp"
#include "sim/wire/encode.hpp"

namespace echofuse::test {

// The firmware, which completes a stop as soon as it is asked for, and sends frames when told.
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

  // A reset or a power cycle: what it was told is forgotten.
  void power_up() {
    firmware_.emplace([this](const std::string& text) { cli.send(text); },
                      [this](const std::string& raw) { data.send(raw); });
    number = 0;
    firmware_->boot();
  }
  void say(const std::string& text) { firmware_->say(text); }
  bool running() const { return firmware_->running().has_value(); }
  // The next frame, with 64 bins, stats and temperature; 256 bytes.
  Bytes frame() {
    ++number;
    std::vector<std::uint16_t> codes(64);
    for (std::size_t i = 0; i < codes.size(); ++i)
      codes[i] = static_cast<std::uint16_t>(3000 + number % 500 + i);
    return sim::radar_frame(
        {number, number * 10'000'000, 0},
        {sim::range_profile_tlv(codes), sim::stats_tlv({}), sim::temperature_tlv({})}, rng_);
  }
  // What the host said since the last call, without bare lines.
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

}  // namespace echofuse::test

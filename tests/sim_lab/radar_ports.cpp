// SPDX-License-Identifier: MIT
// Tests the two ports of the simulated radar without the radar driver.
#include <map>

#include "../drivers/parsed_frames.hpp"
#include "../drivers/sink.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "lab_thread.hpp"
#include "sim/devices/radar_chirp.hpp"
#include "sim/devices/uart.hpp"

using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

// Simulates the board on virtual time, so that the test reads every byte in time.
struct BoardInMemory {
  class Line final : public sim::Uart {
   public:
    Line(port::Loop& loop, unsigned baud, std::string& to) : Uart(loop, baud, 4ms), to_(to) {}

   private:
    std::size_t deliver(Bytes chunk) override {
      to_.append(chunk.begin(), chunk.end());
      return chunk.size();
    }
    std::string& to_;
  };

  // Sends a command. Returns the answer of the board up to the next prompt.
  std::string command(const std::string& line) {
    said.clear();
    const std::string sent = line + '\n';
    to_board({reinterpret_cast<const std::uint8_t*>(sent.data()), sent.size()});
    do loop.run_for(4ms);
    while (!said.ends_with("mmwDemo:/>"));
    return said;
  }
  // Sends the cfg for a resolution of 50 cm, with one line replaced, and starts the sensor.
  void start(const std::string& instead_of = "none", const std::string& put = "") {
    std::istringstream cfg(contents(source_dir + "/config/radar/xwr68xx_paper_50cm.cfg"));
    for (std::string line; std::getline(cfg, line);)
      command(line.starts_with(instead_of) ? put : line);
    REQUIRE(said == "sensorStart\nDone\n\rmmwDemo:/>");
    said.clear();
  }
  // Parses the bytes received from the data port since the previous call, which are complete frames
  // of `size` bytes.
  std::vector<RadarFrame> frames(std::size_t size) {
    const std::string sent = std::exchange(data, {});
    const auto parsed =
        parse_frames({reinterpret_cast<const std::uint8_t*>(sent.data()), sent.size()});
    CHECK(parsed.counts.frame_bytes == size * parsed.frames.size());
    CHECK(parsed.counts.bytes == parsed.counts.frame_bytes);
    return parsed.frames;
  }

  port::VirtualLoop loop;
  sim::Conditions conditions = [] {
    sim::Conditions c = sim::as_board();
    c.radar_snr_db = 40;
    return c;
  }();
  sim::ScenePlayer player{loop, conditions, {"person", 11, 0}};
  std::string said, data;
  sim::Uart::Receive to_board;
  std::unique_ptr<sim::Device> board = sim::make_radar_board(
      loop, player, {},
      [this](unsigned baud, sim::Uart::Receive receive) {
        to_board = std::move(receive);
        return std::make_unique<Line>(loop, baud, said);
      },
      [this](unsigned baud, const sim::Uart::Receive&) {
        return std::make_unique<Line>(loop, baud, data);
      });
};

}  // namespace

TEST_CASE("after sensorStart the simulated radar sends one frame of the scene per frame period") {
  BoardInMemory board;
  board.loop.run_for(100ms);  // receives the banner
  CHECK(board.command("sensorStop") ==
        "sensorStop\nIgnored: Sensor is already stopped\n\rDone\n\rmmwDemo:/>");
  board.start();
  board.loop.run_for(999ms);
  const auto frames = board.frames(256);
  REQUIRE(frames.size() == 20);
  std::vector<double> mean(64, 0.0);
  for (std::size_t i = 0; i < 20; ++i) {
    const RadarFrame& frame = frames[i];
    CHECK(frame.frame_number == i + 1);
    REQUIRE(frame.power.size() == 64);
    CHECK(frame.array.empty());
    // A code is 256 * 12 / 16 times the logarithm of the magnitude.
    for (std::size_t bin = 0; bin < 64; ++bin) mean[bin] += 96 * std::log2(frame.power[bin]) / 20;
    // The cycle counter runs at 200 MHz, and the frames are 50 ms apart.
    CHECK(frame.time_cpu_cycles - frames[0].time_cpu_cycles ==
          Approx(1e7 * static_cast<double>(i)).margin(1));
    REQUIRE(frame.temperature);
    CHECK(frame.temperature->time_ms == Approx(frame.time_cpu_cycles / 200e3).margin(1));
    for (const int celsius : frame.temperature->celsius) CHECK(std::abs(celsius - 45.5) < 2);
    REQUIRE(frame.stats);
    // The active time is that of 96 chirps of 47 us each. Sending 256 bytes takes 2777 us.
    const RadarStats& s = *frame.stats;
    const unsigned transmit_us = i == 0 ? 0 : 2777, margin_us = 50'000 - 96 * 47 - 3000;
    CHECK(std::array{s.inter_frame_processing_us, s.transmit_us, s.inter_chirp_margin_us,
                     s.active_frame_load_percent,
                     s.inter_frame_load_percent} == std::array{3000u, transmit_us, 7u, 20u, 5u});
    CHECK(std::abs(double(s.inter_frame_margin_us) - margin_us + transmit_us) <= 1);
  }

  // Far above the noise, the mean code is the code of the signal power plus the noise power.
  const double step_m = 0.25022102542;  // range step for a slope of 517 frequency steps
  sim::RadarAxis axis{0, step_m, 64, 64 * step_m / 60, sim::Psf::blackman()};
  const auto scene = sim::make_scene(board.conditions, sim::SceneKind::person, 11, 0);
  const auto power = sim::radar_power(sim::radar_returns(scene, board.conditions), axis);
  const auto peak = std::max_element(power.begin(), power.end()) - power.begin();
  CHECK(peak == std::max_element(mean.begin(), mean.end()) - mean.begin());
  const double mean_peak = sim::mean_peak_power(axis, board.conditions);
  const double own = sim::radar_noise_power(board.conditions, mean_peak);
  const double noise = sim::profile_noise(board.conditions, mean_peak, 1);
  int compared = 0;
  for (std::size_t bin = 0; bin < 64; ++bin) {
    if (power[bin] < 20 * noise) continue;
    const double code = 96 * std::log2((power[bin] + noise) * std::pow(2.0, 40));
    // The variance of ln|x|^2 is the sum of (noise / power)^2, caused by the noise common to a
    // frame, and 2 * own / power / 12, caused by the noise of the 12 antennas. The codes are
    // averaged over 20 frames.
    const double variance = std::pow(noise / power[bin], 2) + 2 * own / power[bin] / 12;
    const double sigma = 96 / std::log(2.0) * std::sqrt(variance / 20);
    // The margin of 0.5 allows for the rounding of codes to integers.
    CHECK(std::abs(mean[bin] - code) < 5 * sigma + 0.5);
    ++compared;
  }
  CHECK(compared >= 2);

  const auto sent = board.board->sent();
  const std::map<std::string, std::uint64_t> counts(sent.begin(), sent.end());
  CHECK(counts.at("frames") == 20);
  CHECK(counts.at("data_bytes") == 20 * 256);
  CHECK(counts.at("radiates") == 1);
  for (const char* none : {"frames_skipped", "data_bytes_lost", "cli_bytes_lost"})
    CHECK(counts.at(none) == 0);

  CHECK(board.command("sensorStop") == "sensorStop\nDone\n\rmmwDemo:/>");
  board.loop.run_for(50ms);
  const std::uint32_t last = board.frames(256).back().frame_number;
  board.loop.run_for(200ms);
  CHECK(board.data.empty());
  CHECK(board.command("sensorStart 0") == "sensorStart 0\nDone\n\rmmwDemo:/>");
  board.loop.run_for(30ms);
  // Frame numbers count from power-up rather than from sensorStart.
  CHECK(board.frames(256).front().frame_number == last + 1);
}

TEST_CASE("the simulated radar sends a heat map if the cfg requests it") {
  BoardInMemory board;
  board.start("guiMonitor", "guiMonitor -1 0 1 0 1 0 1");
  board.loop.run_for(149ms);
  // The frame length is 40 + 8 + 128 + 8 + 64 * 8 * 4 + 8 + 24 + 8 + 28 bytes, padded to a multiple
  // of 32 bytes.
  const auto frames = board.frames(2304);
  REQUIRE(frames.size() == 3);
  for (const RadarFrame& frame : frames) {
    REQUIRE(frame.array.size() == 64 * 8 * 2);
    CHECK(std::ranges::any_of(frame.array, [](int v) { return v > 100; }));
  }
}

TEST_CASE("the simulated radar sends one calibration line per frame if requested") {
  BoardInMemory board;
  board.start("measureRangeBias", "measureRangeBiasAndRxChanPhase 1 3.5 1.0");
  board.loop.run_for(500ms);
  const std::string& said = board.said;
  CHECK(std::count(said.begin(), said.end(), '\n') == 10);
  CHECK(said.starts_with("compRangeBiasAndRxChanPhase "));
  const std::string first = said.substr(0, said.find('\n'));
  CHECK(std::count(first.begin(), first.end(), ' ') == 25);
}

TEST_CASE("a host with a wrong baud rate receives noise from the simulated radar") {
  const Folder dir;
  const sim::LabOptions options = options_in(dir, {"person", 11, 0});
  LabThread lab(options);
  port::SystemLoop loop;
  std::string said;
  const auto port = loop.opener("serial:" + options.dir + "/radar-cli", 9600)();
  const std::string line = "version\n";
  port->open({.opened =
                  [&] {
                    port->write({reinterpret_cast<const std::uint8_t*>(line.data()), line.size()});
                  },
              .bytes = [&](ByteView bytes) { said.append(bytes.begin(), bytes.end()); },
              .gone = [](const Failure&) {}});
  CHECK(run_until(loop, [&] { return said.size() >= 60; }));
  CHECK(said.find("version") == said.npos);
}

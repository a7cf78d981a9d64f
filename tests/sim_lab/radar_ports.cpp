// SPDX-License-Identifier: MIT
// Tests the two serial ports of the simulated radar through termios, without the radar driver.
#include <fcntl.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <cstring>

#include "drivers/core/bytes.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "lab_thread.hpp"
#include "sim/devices/radar_chirp.hpp"
#include "sim/devices/uart.hpp"

using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

using Clock = std::chrono::steady_clock;

class Port {
 public:
  Port(const std::string& path, speed_t speed)
      : fd_(::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)) {
    REQUIRE(fd_ >= 0);
    termios settings{};
    ::tcgetattr(fd_, &settings);
    ::cfmakeraw(&settings);
    ::cfsetspeed(&settings, speed);
    REQUIRE(::tcsetattr(fd_, TCSANOW, &settings) == 0);
    ::tcflush(fd_, TCIOFLUSH);
  }
  ~Port() { ::close(fd_); }
  Port(const Port&) = delete;
  Port& operator=(const Port&) = delete;

  void write(const std::string& text) {
    REQUIRE(::write(fd_, text.data(), text.size()) == static_cast<ssize_t>(text.size()));
  }
  // Reads until `enough` returns true or `patience_s` has passed.
  template <class Enough>
  std::string read(double patience_s, Enough enough) {
    std::string all;
    const auto end = Clock::now() + std::chrono::duration<double>(patience_s);
    while (!enough(all) && Clock::now() < end) {
      pollfd ready{fd_, POLLIN, 0};
      if (::poll(&ready, 1, 10) <= 0) continue;
      char chunk[4096];
      const ssize_t n = ::read(fd_, chunk, sizeof chunk);
      if (n > 0) all.append(chunk, static_cast<std::size_t>(n));
    }
    return all;
  }
  std::string until_prompt() {
    return read(3, [](const std::string& s) { return s.find("mmwDemo:/>") != s.npos; });
  }
  std::string command(const std::string& line) {
    write(line + "\n");
    return until_prompt();
  }
  std::string bytes(std::size_t n, double patience_s) {
    return read(patience_s, [n](const std::string& s) { return s.size() >= n; });
  }

 private:
  int fd_;
};

struct Frame {
  std::uint32_t version, length, platform, number, cycles, objects, tlvs, subframe;
  std::vector<std::uint16_t> profile;
  std::vector<std::int16_t> heat_map;
  std::vector<std::uint32_t> types;
};

// Parses the first frame in `bytes` and removes this frame from `bytes`.
Frame take_frame(std::string& bytes) {
  REQUIRE(bytes.size() >= 40);
  REQUIRE(std::memcmp(bytes.data(), "\x02\x01\x04\x03\x06\x05\x08\x07", 8) == 0);
  ByteReader in({reinterpret_cast<const std::uint8_t*>(bytes.data()) + 8, bytes.size() - 8});
  Frame f{};
  for (std::uint32_t* field :
       {&f.version, &f.length, &f.platform, &f.number, &f.cycles, &f.objects, &f.tlvs, &f.subframe})
    *field = in.get<std::uint32_t>();
  REQUIRE(f.length <= bytes.size());
  for (std::uint32_t i = 0; i < f.tlvs; ++i) {
    f.types.push_back(in.get<std::uint32_t>());
    const ByteView payload = in.take(in.get<std::uint32_t>());
    if (f.types.back() == 2) f.profile = to_values<std::uint16_t>(payload);
    if (f.types.back() == 4) f.heat_map = to_values<std::int16_t>(payload);
  }
  REQUIRE(in.ok());
  bytes.erase(0, f.length);
  return f;
}

void configure(Port& cli, const std::string& cfg_path) {
  std::istringstream cfg(contents(cfg_path));
  for (std::string line; std::getline(cfg, line);) {
    if (line.empty() || line[0] == '%') continue;
    const std::string reply = cli.command(line);
    INFO(line << " -> " << reply);
    REQUIRE(reply.find("Done\n\r") != reply.npos);
  }
}

// Simulates the board on virtual time. A pseudo-terminal is not used, because it would hold only 4
// KiB, and the rest would be lost if the test read late.
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

  // Sends the cfg for a resolution of 50 cm, with one line replaced, and starts the sensor.
  void start(const std::string& instead_of, const std::string& put) {
    std::istringstream cfg(contents(source_dir + "/config/radar/xwr68xx_paper_50cm.cfg"));
    for (std::string line; std::getline(cfg, line);) {
      if (line.rfind(instead_of, 0) == 0) line = put;
      line += '\n';
      to_board({reinterpret_cast<const std::uint8_t*>(line.data()), line.size()});
      do loop.run_for(4ms);
      while (!said.ends_with("mmwDemo:/>"));
    }
    REQUIRE(said.ends_with("sensorStart\nDone\n\rmmwDemo:/>"));
    said.clear();
  }

  port::VirtualLoop loop;
  sim::ScenePlayer player{loop, {}, {"person", 11, 0}};
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
  const Folder dir;
  sim::LabOptions options = options_in(dir, {"person", 11, 0});
  options.conditions.radar_snr_db = 40;
  LabThread lab(options);
  Port cli(options.dir + "/radar-cli", B115200), data(options.dir + "/radar-data", B921600);
  // Discards any remaining part of the banner.
  cli.bytes(1 << 20, 0.1);
  CHECK(cli.command("") == "\nmmwDemo:/>");
  CHECK(cli.command("sensorStop") ==
        "sensorStop\nIgnored: Sensor is already stopped\n\rDone\n\rmmwDemo:/>");
  CHECK(data.bytes(1, 0.2).empty());
  configure(cli, options.dir + "/radar.cfg");

  constexpr std::size_t frame_bytes = 256, frames = 20;
  std::string wire = data.bytes(frames * frame_bytes, 3);
  REQUIRE(wire.size() >= frames * frame_bytes);
  std::uint32_t cycles = 0;
  std::vector<double> mean(64, 0.0);
  for (std::uint32_t i = 1; i <= frames; ++i) {
    const Frame frame = take_frame(wire);
    CHECK(frame.version == 0x03050004);
    CHECK(frame.length == frame_bytes);
    CHECK(frame.platform == 0xA6843);
    CHECK(frame.number == i);
    CHECK(frame.types == std::vector<std::uint32_t>{2, 6, 9});
    REQUIRE(frame.profile.size() == 64);
    for (std::size_t bin = 0; bin < 64; ++bin) mean[bin] += frame.profile[bin] / double(frames);
    // The cycle counter runs at 200 MHz, and the frames are 50 ms apart. The tolerance is large,
    // because scheduling may be delayed on a busy machine.
    if (i > 1) CHECK(std::abs(double(frame.cycles - cycles) / 1e7 - 1) < 0.8);
    cycles = frame.cycles;
  }

  // Far above the noise, the mean code is the code of the signal power plus the noise power.
  const double step_m = 0.25022102542;  // range step for a slope of 517 frequency steps
  sim::RadarAxis axis{0, step_m, 64, 64 * step_m / 60, sim::Psf::blackman()};
  const auto scene = sim::make_scene(options.conditions, sim::SceneKind::person, 11, 0);
  const auto power = sim::radar_power(sim::radar_returns(scene, options.conditions), axis);
  const auto peak = std::max_element(power.begin(), power.end()) - power.begin();
  CHECK(peak == std::max_element(mean.begin(), mean.end()) - mean.begin());
  const double mean_peak = sim::mean_peak_power(axis, options.conditions);
  const double own = sim::radar_noise_power(options.conditions, mean_peak);
  const double noise = sim::profile_noise(options.conditions, mean_peak, 1);
  int compared = 0;
  for (std::size_t bin = 0; bin < 64; ++bin) {
    if (power[bin] < 20 * noise) continue;
    const double code = 256 * 12.0 / 16 * 0.5 * std::log2((power[bin] + noise) * std::pow(2.0, 40));
    // The variance of ln|x|^2 is the sum of (noise / power)^2, caused by the noise common to a
    // frame, and 2 * own / power / 12, caused by the noise of the 12 antennas. The codes are
    // averaged over 20 frames.
    const double variance = std::pow(noise / power[bin], 2) + 2 * own / power[bin] / 12;
    const double sigma = 256 * 12 / 16.0 * 0.5 / std::log(2.0) * std::sqrt(variance / frames);
    // The margin of 0.5 allows for the rounding of codes to integers.
    CHECK(std::abs(mean[bin] - code) < 5 * sigma + 0.5);
    ++compared;
  }
  CHECK(compared >= 2);

  CHECK(cli.command("sensorStop") == "sensorStop\nDone\n\rmmwDemo:/>");
  wire += data.bytes(1 << 20, 0.3);
  std::uint32_t last = frames;
  while (!wire.empty()) last = take_frame(wire).number;
  CHECK(cli.command("sensorStart 0") == "sensorStart 0\nDone\n\rmmwDemo:/>");
  wire = data.bytes(frame_bytes, 2);
  // Frame numbers count from power-up rather than from sensorStart.
  CHECK(take_frame(wire).number == last + 1);
}

TEST_CASE("the simulated radar sends a heat map if the cfg requests it") {
  BoardInMemory board;
  board.start("guiMonitor", "guiMonitor -1 0 1 0 1 0 1");
  // The frame length is 40 + 8 + 128 + 8 + 64 * 8 * 4 + 8 + 24 + 8 + 28 bytes, padded to a multiple
  // of 32 bytes.
  constexpr std::size_t frame_bytes = 2304;
  board.loop.run_for(150ms);
  for (std::uint32_t i = 1; i <= 2; ++i) {
    const Frame frame = take_frame(board.data);
    CHECK(frame.number == i);
    CHECK(frame.length == frame_bytes);
    CHECK(frame.types == std::vector<std::uint32_t>{2, 4, 6, 9});
    REQUIRE(frame.heat_map.size() == 64 * 8 * 2);
    CHECK(std::any_of(frame.heat_map.begin(), frame.heat_map.end(), [](int v) { return v > 100; }));
  }
}

TEST_CASE("the simulated radar sends one calibration line per frame if requested") {
  BoardInMemory board;
  board.start("measureRangeBias", "measureRangeBiasAndRxChanPhase 1 3.5 1.0");
  board.loop.run_for(500ms);
  const std::string& said = board.said;
  CHECK(std::count(said.begin(), said.end(), '\n') == 10);
  CHECK(said.rfind("compRangeBiasAndRxChanPhase ", 0) == 0);
  const std::string first = said.substr(0, said.find('\n'));
  CHECK(std::count(first.begin(), first.end(), ' ') == 25);
}

TEST_CASE("a host with a wrong baud rate receives noise from the simulated radar") {
  const Folder dir;
  const sim::LabOptions options = options_in(dir, {"person", 11, 0});
  LabThread lab(options);
  Port cli(options.dir + "/radar-cli", B9600);
  cli.write("version\n");
  const std::string said = cli.bytes(60, 2);
  CHECK(said.size() >= 60);
  CHECK(said.find("version") == said.npos);
}

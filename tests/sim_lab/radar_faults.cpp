// SPDX-License-Identifier: MIT
// Tests how the radar driver responds to faults of the board and its connection. The driver is
// connected to simulated firmware by two wires in memory. Bytes arrive exactly as the test sends
// them, and are never lost by the wires.
#include <map>
#include <optional>
#include <set>

#include "../drivers/sink.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/paths.hpp"
#include "../fixtures/wire.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "drivers/radar/log2_codes.hpp"
#include "drivers/radar/radar_driver.hpp"
#include "sim/devices/radar_firmware.hpp"
#include "sim/wire/encode.hpp"

using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

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

struct Bench {
  explicit Bench(radar::RadarSetup with = {}) : board(loop), setup(std::move(with)) {
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
  bool until(Condition condition, std::chrono::milliseconds limit = 10s) {
    const auto end = loop.now() + limit;
    while (!condition()) {
      if (loop.now() > end) return false;
      if (board.running()) board.data.send(board.frame());
      run_until(loop, condition, 10ms);
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

using Strings = std::vector<std::string>;

const Strings restart{"version", "sensorStop", "sensorStart 0"};

radar::RadarSetup hasty() {
  radar::RadarSetup setup;
  setup.backoff = port::Backoff(2ms, 8ms);
  setup.timeouts = {.quiet = 3ms, .prompt = 100ms, .answer = 200ms, .start = 200ms};
  return setup;
}

}  // namespace

TEST_CASE(
    "the radar driver restarts the sensor after an unplug, and sends the cfg again after a reset") {
  struct Row {
    bool unplug, reset;
    std::size_t configured, restarted;
    const char* reported;
  };
  // A board that was reset refuses the restart, or announces itself with a banner.
  const Row row =
      GENERATE(Row{true, false, 1, 1, "read: No such device"},
               Row{true, true, 2, 0, "restart refused, sending the cfg again: Error: Full"},
               Row{false, true, 2, 0, "the board was reset"});
  CAPTURE(row.reported);
  Bench b;
  b.start();
  if (row.unplug) {
    b.plug(false);
    REQUIRE(b.faulted());
    b.until([&] { return false; }, 500ms);
  }
  if (row.reset) b.board.power_up();
  b.plug(true);
  CHECK(b.seconds_to_frame() < 10);
  Strings expected = row.unplug ? restart : b.whole_cfg;
  if (row.unplug && row.reset)
    expected.insert(expected.end(), b.whole_cfg.begin() + 1, b.whole_cfg.end());
  CHECK(b.board.heard() == expected);
  CHECK(b.count("configured") == row.configured);
  CHECK(b.count("restarted") == row.restarted);
  CHECK(b.state() == DeviceState::streaming);
  CHECK(b.reported(row.reported));
  // The restart of the frame numbers after a power cycle must not cause another reconnection.
  REQUIRE(b.until([&] { return b.frames() > 20; }));
  CHECK(b.count("connections") == 2);
  if (!row.reset) b.check_all_accounted_for();
}

TEST_CASE("the radar driver detects a board reset by the frame numbers if no banner arrives") {
  Bench b;
  b.start();
  REQUIRE(b.until([&] { return b.board.number >= 20; }));
  SECTION("the driver configures the board again if frame numbers restart") {
    b.board.number = 0;
    REQUIRE(b.faulted());
    CHECK(b.sink.events.back() == "the board was reset: frame numbers restarted");
    b.seconds_to_frame();
    CHECK(b.board.heard() == b.whole_cfg);
    CHECK(b.count("configured") == 2);
  }
  SECTION("a frame number with flipped bits is not treated as a reset") {
    for (const unsigned bit : {0u, 2u, 4u, 9u, 20u, 31u}) {
      Bytes frame = b.board.frame();
      frame[20 + bit / 8] ^= static_cast<std::uint8_t>(1u << bit % 8);
      b.board.data.send(frame);
      const std::size_t before = b.frames();
      REQUIRE(b.until([&] { return b.frames() > before + 3; }));
    }
    CHECK(b.count("connections") == 1);
    CHECK(b.count("restarts") == 0);
  }
}

TEST_CASE("a radar board reset during configuration restarts the command dialogue") {
  Bench b;
  b.driver->start(b.sink);
  REQUIRE(b.until([&] { return b.board.lines_heard() == 12; }));
  b.board.power_up();
  CHECK(b.seconds_to_frame() < 10);
  CHECK(std::any_of(b.sink.events.begin(), b.sink.events.end(), [](const std::string& event) {
    return event.starts_with("x.cfg:") && event.ends_with(": the board was reset");
  }));
  CHECK(b.count("configured") == 1);
}

TEST_CASE("the radar driver repeats the last error of the board until a frame arrives") {
  Bench b(hasty());
  b.start();
  b.board.say("Exception: mmw_cli.c, line 263.\n");
  b.board.cli.cut = true;
  REQUIRE(b.until(
      [&] { return b.reported("Exception: mmw_cli.c, line 263. (the firmware has stopped"); }));
  const std::string then = "; then: the firmware stopped responding; reset the board";
  REQUIRE(b.until([&] { return b.sink.events.back().ends_with(then); }));
  CHECK(b.sink.events.back().starts_with("Exception: mmw_cli.c, line 263."));
  b.board.power_up();
  b.board.cli.cut = false;
  b.seconds_to_frame();
  b.plug(false);
  REQUIRE(b.faulted());
  CHECK(b.sink.events.back().find("Exception") == std::string::npos);
}

TEST_CASE("damaged radar data cause the loss of at most one intact frame, and losses are counted") {
  using Damage = std::function<void(Bytes&, Rng&)>;
  const auto flip = [](Bytes& f, std::size_t at, Rng& rng) {
    f[at] ^= static_cast<std::uint8_t>(1 << rng() % 8);
  };
  const std::map<std::string, Damage> damages{
      {"garbage before a frame",
       [](Bytes& f, Rng& rng) {
         Bytes junk(1 + rng() % 700);
         for (auto& byte : junk) byte = static_cast<std::uint8_t>(rng());
         f.insert(f.begin(), junk.begin(), junk.end());
       }},
      {"bytes lost inside",
       [](Bytes& f, Rng& rng) {
         const auto from = f.begin() + static_cast<std::ptrdiff_t>(rng() % (f.size() - 40));
         f.erase(from, from + 1 + static_cast<std::ptrdiff_t>(rng() % 39));
       }},
      {"bit flip", [&](Bytes& f, Rng& rng) { flip(f, rng() % f.size(), rng); }},
      {"bit flip in the length", [&](Bytes& f, Rng& rng) { flip(f, 12 + rng() % 4, rng); }},
      {"repeated",
       [](Bytes& f, Rng&) {
         const Bytes copy = f;
         f.insert(f.end(), copy.begin(), copy.end());
       }},
      {"missing", [](Bytes& f, Rng&) { f.clear(); }},
  };
  for (const auto& [name, damage] : damages) {
    Bench b(hasty());
    b.start();
    Rng rng = make_rng(7, 7);
    const std::uint32_t first = b.board.number + 1;
    std::set<std::uint32_t> good;
    for (int i = 0; i <= 600; ++i) {
      Bytes frame = b.board.frame();
      if (i % 6 == 5)
        damage(frame, rng);
      else
        good.insert(b.board.number);
      b.board.data.send(frame);
    }
    REQUIRE(run_until(b.loop, [&] { return b.sink.radar.back().frame_number == b.board.number; }));
    std::size_t accounted = b.count("lost_frames");
    for (const RadarFrame& f : b.sink.radar) {
      if (f.frame_number < first) continue;
      ++accounted;
      // Frames have no checksum, so a flipped bit may change the content.
      if (good.erase(f.frame_number) > 0 && name != "bit flip")
        REQUIRE(f.power.at(5) ==
                radar::power_from_code(static_cast<std::uint16_t>(3000 + f.frame_number % 500 + 5),
                                       12));
    }
    const std::size_t sent = name == "repeated" ? 701 : 601;
    CAPTURE(name, good.size(), accounted);
    CHECK(good.size() <= 100);
    // A flipped bit in a frame number may look like a small gap, and the missing numbers are then
    // counted as lost frames.
    CHECK((name == "bit flip" ? accounted >= sent : accounted == sent));
    CHECK(b.count("connections") == 1);
  }
}

TEST_CASE("the radar driver configures the board again if no frames arrive on the data port") {
  Bench b;
  b.start();
  const HostTime from = b.loop.now();
  REQUIRE(run_until(b.loop, [&] {
    b.board.data.send(std::string("\x02"));
    b.loop.run_for(100ms);
    return b.state() == DeviceState::faulted;
  }));
  CHECK(b.sink.events.back() == "no frames on the data port");
  CHECK(b.loop.now() - from < 10s);
  CHECK(b.seconds_to_frame() < 10);
  CHECK(b.count("configured") == 2);
}

TEST_CASE("after an unplug the radar driver waits until both ports are back") {
  Bench b(hasty());
  b.start();
  b.plug(false);
  REQUIRE(b.faulted());
  // Only the command port is back. The data port is still missing.
  b.board.cli.plug(true);
  REQUIRE(b.until([&] { return b.count("connections") == 1; }));
  b.plug(true);
  CHECK(b.seconds_to_frame() < 10);
}

TEST_CASE("the radar driver recovers from an unplug at any step of the command dialogue") {
  Bench b(hasty());
  b.start();
  Rng rng = make_rng(3, 3);
  for (int i = 0; i < 100; ++i) {
    b.plug(false);
    REQUIRE(b.faulted());
    b.loop.run_for(1ms);
    b.board.heard();
    if (rng() % 2) b.board.power_up();
    b.plug(true);
    const std::size_t step = 1 + rng() % 40, before = b.frames();
    REQUIRE(b.until([&] { return b.board.lines_heard() >= step || b.frames() > before; }));
  }
  CHECK(b.seconds_to_frame() < 10);
  CHECK(b.count("connections") == 101);
  CHECK(b.count("bad_headers") == 0);
}

TEST_CASE("the radar driver waits longer each time a board fails after its first frame") {
  Bench b;
  b.start();
  std::vector<double> pauses;
  for (int i = 0; i < 5; ++i) {
    b.plug(false);
    REQUIRE(b.faulted());
    b.plug(true);
    pauses.push_back(b.seconds_to_frame());
  }
  // Before the five reconnections, the driver waits for 0.1, 0.2, 0.4, 0.8 and 1.6 s, respectively.
  for (std::size_t i = 0; i < pauses.size(); ++i) CHECK(pauses[i] > 0.1 * (1 << i));
}

TEST_CASE("the radar driver reports a missing first frame with the cause and a remedy") {
  const auto reported = [](const std::function<void(RadarBoard&)>& fault) {
    Bench b;
    b.driver->start(b.sink);
    REQUIRE(run_until(b.loop, [&] { return b.board.running(); }));
    b.loop.run_for(1s);
    fault(b.board);
    REQUIRE(run_until(b.loop, [&] { return b.state() == DeviceState::faulted; }));
    CHECK(b.sink.events.back().starts_with("no frames on the data port: "));
    return b.sink.events.back();
  };
  CHECK_THAT(reported([](RadarBoard&) {}), Catch::Contains("image is for a different board"));
  CHECK_THAT(
      reported([](RadarBoard& board) { board.data.cut = true; }),
      Catch::Contains("no bytes received") && Catch::Contains("radar.data is the wrong port"));
  CHECK_THAT(reported([](RadarBoard& b) { b.cli.cut = true; }),
             Catch::Contains("processor has stopped"));
  CHECK_THAT(reported([](RadarBoard& board) {
               board.data.noise(std::string(500, 'x')), board.data.cut = true;
             }),
             Catch::Contains("500 bytes received, but no frame"));
}

TEST_CASE("the time stamp of a radar frame is the time of its first chirp") {
  Bench b;
  b.start();
  const HostTime sent = b.loop.now();
  b.board.data.send(b.board.frame());
  REQUIRE(run_until(b.loop, [&, before = b.frames()] { return b.frames() > before; }));
  // A frame consists of 96 chirps of 47 us each. The 256 bytes of the frame are sent as 2560 bits
  // at 921600 baud.
  CHECK(seconds(sent - b.sink.radar.back().received) ==
        Approx(96 * 47e-6 + 2560 / 921600.).margin(1e-4));
}

namespace {

// Radar driver connected to the command port of one board and to the data port of another board.
// The other board sends frames.
struct TwoBoards : Bench {
  TwoBoards() : other(loop) {
    setup.data = other.data.opener();
    driver.emplace(loop, setup);
  }
  bool reach(DeviceState required, std::chrono::milliseconds period) {
    const HostTime end = loop.now() + 10s;
    while (state() != required && loop.now() < end) {
      other.data.send(other.frame());
      run_until(
          loop, [&] { return state() == required; }, period);
    }
    return state() == required;
  }
  RadarBoard other;
};

}  // namespace

TEST_CASE(
    "the radar driver detects ports of two boards if a stopped sensor appears to send frames") {
  TwoBoards b;
  b.driver->start(b.sink);
  REQUIRE(b.reach(DeviceState::misconfigured, GENERATE(10ms, 50ms, 120ms)));
  CHECK_THAT(
      b.sink.events.back(),
      Catch::StartsWith("radar.cli and radar.data are ports of two different boards: frame "));
  CHECK(b.sink.radar.empty());
  CHECK_FALSE(b.board.running());
  CHECK(b.board.heard() ==
        // The host has sent all lines except sensorStart.
        Strings(b.whole_cfg.begin(), b.whole_cfg.end() - 1));
}

TEST_CASE("the radar driver accepts a board that sends frames when the driver connects") {
  radar::RadarSetup setup;
  setup.keep_running = true;
  Bench b(setup);
  b.start();
  b.driver.emplace(b.loop, b.setup);
  REQUIRE(b.board.running());
  const std::size_t before = b.frames();
  b.driver->start(b.sink);
  REQUIRE(b.until([&] { return b.frames() >= before + 20; }));
  CHECK(b.count("connections") == 1);
  CHECK(b.count("early_frames") > 0);
  CHECK_FALSE(b.reported("radar.cli and radar.data"));
}

TEST_CASE("the radar driver accepts a last frame that arrives after the answer to sensorStop") {
  Bench b;
  const auto late = GENERATE(10ms, 100ms, 200ms);
  b.driver->start(b.sink);
  REQUIRE(run_until(b.loop, [&] { return b.board.lines_heard() >= 2; }));
  b.loop.run_for(late);
  b.board.data.send(b.board.frame());
  REQUIRE(b.until([&] { return b.frames() >= 3; }));
  CHECK(b.count("connections") == 1);
}

TEST_CASE("the radar driver warns once if the frame period differs from the cfg") {
  Bench b;
  b.driver->start(b.sink);
  const bool odd = GENERATE(false, true);
  REQUIRE(b.until([&] { return b.board.running(); }));
  for (int i = 0; i < 10; ++i) {
    // The frames are 10^7 cycles (50 ms) apart, as specified in the cfg. If `odd` is true, the
    // interval is ten times longer.
    Bytes frame = b.board.frame();
    const auto cycles =
        static_cast<std::uint32_t>(b.board.number * (odd ? 100'000'000 : 10'000'000));
    for (std::size_t k = 0; k < 4; ++k) frame[24 + k] = static_cast<std::uint8_t>(cycles >> 8 * k);
    b.board.data.send(frame);
    b.loop.run_for(50ms);
  }
  const std::string text =
      "frames arrive every 500 ms, but the cfg requests 50 ms: is radar.data a port";
  CHECK(std::ranges::count_if(b.sink.events,
                              [&](const std::string& e) { return e.starts_with(text); }) == odd);
  CHECK(b.frames() >= 8);
}

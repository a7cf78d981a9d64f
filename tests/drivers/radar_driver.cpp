// SPDX-License-Identifier: MIT
// Tests the radar driver over real pseudo-terminals with a minimal simulated firmware.
#include <pty.h>
#include <unistd.h>

#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/write.hpp>

#include "../fixtures/folder.hpp"
#include "drivers/make_driver.hpp"
#include "drivers/radar/profile.hpp"
#include "hex.hpp"
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

// Pseudo-terminal that replaces a serial line. The driver opens the far end of the pseudo-terminal
// through the symbolic link `link`.
class Line {
 public:
  Line(port::SystemLoop& loop, const std::string& link) : master_(loop.io()), link_(link) {
    int master = -1;
    char name[128];
    REQUIRE(openpty(&master, &slave_, name, nullptr, nullptr) == 0);
    termios raw;
    tcgetattr(slave_, &raw);
    cfmakeraw(&raw);
    tcsetattr(slave_, TCSANOW, &raw);
    master_.assign(master);
    std::filesystem::create_symlink(name, link_);
  }
  ~Line() {
    ::close(slave_);
    std::filesystem::remove(link_);
  }
  Line(const Line&) = delete;
  Line& operator=(const Line&) = delete;
  void send(ByteView bytes) {
    boost::asio::write(master_, boost::asio::buffer(bytes.data(), bytes.size()));
  }
  void receive(std::function<void(ByteView)> handler) {
    master_.async_read_some(boost::asio::buffer(buffer_),
                            [this, handler](const boost::system::error_code& error, std::size_t n) {
                              if (error) return;
                              handler(ByteView(buffer_).first(n));
                              receive(handler);
                            });
  }

 private:
  boost::asio::posix::stream_descriptor master_;
  std::string link_;
  // Kept open so that the pseudo-terminal continues to exist after the driver has closed its end.
  int slave_ = -1;
  std::array<std::uint8_t, 256> buffer_{};
};

// Simulates the radar's command port, which sends an echo, an answer and a prompt for each command.
struct Board {
  Board(port::SystemLoop& loop, const test::Folder& dir)
      : cli(loop, dir / "cli"), data(loop, dir / "data") {
    cli.receive([this](ByteView bytes) {
      for (const std::uint8_t byte : bytes) {
        if (byte != '\n') {
          line += static_cast<char>(byte);
          continue;
        }
        lines.push_back(line);
        const std::string version =
            line == "version" ? "mmWave SDK Version      : 03.05.00.04\n\r" : "";
        cli.send(test::view_of(line + "\r\n" + version + (line.empty() ? "" : "Done\n\r") +
                               "mmwDemo:/>"));
        line.clear();
      }
    });
  }

  Line cli, data;
  std::string line;
  std::vector<std::string> lines;
};

struct Bench {
  void start(const std::string& text = cfg) {
    driver = make_radar(loop, {"serial:" + dir / "cli", "serial:" + dir / "data", text, "x.cfg"});
    driver->start(sink);
  }
  std::uint64_t count(const char* name) const { return test::counter(*driver, name); }
  bool configured() {
    return run_until(loop, [&] { return count("configured") == 1; });
  }

  test::Folder dir;
  port::SystemLoop loop;
  test::KeepingSink sink;
  std::unique_ptr<Driver> driver;
};

}  // namespace

TEST_CASE("the radar driver sends the cfg unchanged and then receives frames") {
  Bench b;
  Board board(b.loop, b.dir);
  // Bytes that were waiting before the port is opened are discarded.
  board.data.send(test::view_of("bytes of yesterday"));
  b.start();
  REQUIRE(b.configured());
  std::vector<std::string> expected{"", "version"};
  for (const auto& line : radar::command_lines(cfg)) expected.push_back(line.text);
  CHECK(board.lines == expected);
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
  Board board(b.loop, b.dir);
  std::string text = cfg;
  for (const auto& [from, to] : std::vector<std::pair<std::string, std::string>>{
           {"256 12500", "4 12500"},
           {"frameCfg 0 0", "chirpCfg 1 1 0 0 0 0 0 4\nframeCfg 0 1"},
           {"-1 0 1 0 0 0 1", "-1 0 1 0 1 0 1"}})
    text.replace(text.find(from), from.size(), to);
  b.start(text);
  REQUIRE(b.configured());
  board.data.send(test::join(test::read_golden("radar_array.hex")));
  REQUIRE(run_until(b.loop, [&] { return b.sink.radar.size() == 4; }));
  REQUIRE(b.sink.info.axes.size() == 2);
  CHECK(b.sink.info.axes[1].name == "array");
  CHECK(b.sink.info.axes[1].count == 4);
  CHECK(b.sink.info.axes[1].scale == 8);
  CHECK(b.sink.radar[0].array.size() == 64);
  CHECK(b.sink.radar[1].array.empty());
  CHECK(b.sink.radar[1].power.size() == 4);
  CHECK(b.sink.radar[2].array.size() == 64);
  CHECK(b.count("arrays") == 3);
  CHECK(b.count("bad_arrays") == 1);
  CHECK(b.sink.events == std::vector<std::string>{
                             "the heat map has 48 samples in TLV 8, but the cfg and radar.board "
                             "require 32 in TLV 4; the heat map is ignored"});
  b.driver->stop();
}

TEST_CASE("a missing radar port is reported with its name") {
  Bench b;
  b.start();
  REQUIRE(run_until(b.loop, [&] { return b.sink.state() == DeviceState::faulted; }));
  CHECK_THAT(b.sink.events.at(0),
             Catch::Contains(b.dir / "cli" + ": cannot open: No such file or directory"));
}

TEST_CASE("swapped radar ports are detected by their names when the driver starts") {
  Bench b;
  const std::string by_id = "serial:/dev/serial/by-id/usb-Texas_Instruments_XDS110_R1-if0";
  const auto swapped = make_radar(b.loop, {by_id + "3", by_id + "0", cfg, "x.cfg"});
  swapped->start(b.sink);
  REQUIRE(b.sink.events.size() == 2);
  CHECK_THAT(b.sink.events[0], Catch::Contains("radar.cli") && Catch::Contains("data port"));
  CHECK_THAT(b.sink.events[1], Catch::Contains("radar.data") && Catch::Contains("command port"));
  swapped->stop();
  b.sink.events.clear();
  const auto right = make_radar(b.loop, {by_id + "0", by_id + "3", cfg, "x.cfg"});
  right->start(b.sink);
  CHECK(b.sink.events.empty());
  right->stop();
}

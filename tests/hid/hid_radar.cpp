// SPDX-License-Identifier: MIT
// The simulated radar board behind two CP2110, the unmodified driver above.
#include <algorithm>
#include <catch2/catch.hpp>
#include <fstream>
#include <sstream>

#include "../drivers/sink.hpp"
#include "../paths.hpp"
#include "bed.hpp"
#include "drivers/core/random.hpp"
#include "drivers/make_driver.hpp"
#include "tests/emulation/hid_uart.hpp"

using namespace echofuse;
using test::run_until;

namespace {

// Board and driver share one loop.
struct Bench {
  Bench() {
    const auto uart = [this](unsigned number, const char* serial, sim::HidUart*& made) {
      return [this, number, serial, &made](unsigned baud, sim::Uart::Receive receive) {
        auto out = std::make_unique<sim::HidUart>(
            loop, test::bed(), sim::HidOptions{number, serial}, baud, std::move(receive));
        made = out.get();
        return out;
      };
    };
    board = sim::make_radar_board(loop, player, {}, uart(0, "CLI", cli), uart(1, "DATA", data));
    std::ifstream cfg(echofuse::test::source_dir + "/config/radar/xwr68xx_paper_50cm.cfg");
    std::ostringstream text;
    text << cfg.rdbuf();
    driver = make_radar(loop, {"hid:10c4:ea80:CLI", "hid:10c4:ea80:DATA", text.str(), "paper.cfg"});
  }
  auto told(const std::string& start) const {
    return std::count_if(sink.events.begin(), sink.events.end(),
                         [&](const std::string& text) { return text.starts_with(start); });
  }

  port::SystemLoop loop;
  sim::ScenePlayer player{loop, {}, {}};
  sim::HidUart *cli = nullptr, *data = nullptr;
  std::unique_ptr<sim::Device> board;
  std::unique_ptr<Driver> driver;
  test::KeepingSink sink;
};

}  // namespace

TEST_CASE("dialogue and frames over two HID ports, unplug and back") {
  Bench b;
  b.driver->start(b.sink);
  REQUIRE(run_until(
      b.loop, [&] { return b.sink.radar.size() >= 20; }, std::chrono::seconds(20)));
  CHECK(b.data->bridge().baud() == 921600);
  CHECK(b.sink.state() == DeviceState::streaming);
  CHECK(b.sink.radar[0].frame_number + 19 == b.sink.radar[19].frame_number);
  CHECK(test::counter(*b.driver, "lost_frames") == 0);
  CHECK(test::counter(*b.driver, "junk_bytes") == 0);
  CHECK(test::counter(*b.driver, "port_losses") == 0);
  CHECK(b.told("hid:10c4:ea80:DATA: 921600 baud") == 1);
  CHECK(b.told("hid:") == 1);

  b.data->bridge().unplug();
  REQUIRE(run_until(b.loop, [&] { return b.sink.state() == DeviceState::faulted; }));
  const std::size_t before = b.sink.radar.size();
  b.data->bridge().plug();
  const auto start = std::chrono::steady_clock::now();
  REQUIRE(run_until(
      b.loop, [&] { return b.sink.radar.size() >= before + 20; }, std::chrono::seconds(20)));
  WARN("20 frames after "
       << std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() << " s");
  CHECK(b.sink.state() == DeviceState::streaming);
  CHECK(test::counter(*b.driver, "connections") >= 2);
  b.driver->stop();
  b.board->stop();
}

TEST_CASE("an overrun becomes an event and a count") {
  Bench b;
  b.driver->start(b.sink);
  REQUIRE(run_until(
      b.loop, [&] { return b.sink.radar.size() >= 2; }, std::chrono::seconds(20)));
  b.data->bridge().receive(Bytes(900, 0x55));
  REQUIRE(run_until(b.loop, [&] { return test::counter(*b.driver, "port_losses") > 0; }));
  CHECK(b.told("hid:10c4:ea80:DATA: overrun: the bridge lost bytes") == 1);
  const std::size_t before = b.sink.radar.size();
  REQUIRE(run_until(b.loop, [&] { return b.sink.radar.size() >= before + 20; }));
  CHECK(test::counter(*b.driver, "connections") == 1);
  b.driver->stop();
  b.board->stop();
}

TEST_CASE("garbage and cut frames between good ones") {
  Bench b;
  b.driver->start(b.sink);
  REQUIRE(run_until(
      b.loop, [&] { return b.sink.radar.size() >= 5; }, std::chrono::seconds(20)));
  Rng rng(1);
  Bytes noise(200);
  for (auto& byte : noise) byte = static_cast<std::uint8_t>(rng());
  // The first 100 bytes of a frame: magic, version, length 256, platform, number of the last one.
  Bytes cut{2, 1, 4, 3, 6, 5, 8, 7, 4, 0, 5, 3, 0, 1, 0, 0, 0x43, 0x68, 0x0A, 0};
  cut.resize(100);
  for (const bool whole_noise : {true, false, true, false}) {
    const std::size_t before = b.sink.radar.size();
    cut[20] = static_cast<std::uint8_t>(b.sink.radar.back().frame_number);
    const Bytes& damage = whole_noise ? noise : cut;
    b.data->bridge().receive(damage);
    REQUIRE(run_until(b.loop, [&] { return b.sink.radar.size() >= before + 5; }));
  }
  CHECK(test::counter(*b.driver, "connections") == 1);
  const auto first = b.sink.radar.front().frame_number, last = b.sink.radar.back().frame_number;
  const std::uint64_t lost = last - first + 1 - b.sink.radar.size();
  CHECK(lost <= 4);  // at most one a damage
  CHECK(test::counter(*b.driver, "lost_frames") == lost);
  CHECK(test::counter(*b.driver, "junk_bytes") + test::counter(*b.driver, "truncated_frames") +
            test::counter(*b.driver, "bad_headers") + test::counter(*b.driver, "bad_tlvs") >
        0);
  b.driver->stop();
  b.board->stop();
}

TEST_CASE("the command port unplugged in mid-dialogue, again and again") {
  Bench b;
  b.driver->start(b.sink);
  for (std::uint64_t i = 1; i <= 3; ++i) {
    REQUIRE(run_until(b.loop, [&] { return test::counter(*b.driver, "connections") == i; }));
    const auto reports = b.cli->bridge().output_reports();
    REQUIRE(run_until(b.loop, [&] { return b.cli->bridge().output_reports() >= reports + 2; }));
    CHECK(test::counter(*b.driver, "configured") == 0);
    b.cli->bridge().unplug();
    REQUIRE(run_until(b.loop, [&] { return b.sink.state() == DeviceState::faulted; }));
    b.cli->bridge().plug();
  }
  REQUIRE(run_until(
      b.loop, [&] { return b.sink.radar.size() >= 10; }, std::chrono::seconds(20)));
  CHECK(b.sink.state() == DeviceState::streaming);
  b.driver->stop();
  b.board->stop();
}

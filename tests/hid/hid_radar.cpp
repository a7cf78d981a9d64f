// SPDX-License-Identifier: MIT
// Tests the unmodified driver with a simulated radar board behind two CP2110 chips.

#include "../drivers/sink.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/paths.hpp"
#include "bed.hpp"
#include "drivers/core/random.hpp"
#include "drivers/make_driver.hpp"
#include "sim/devices/uart.hpp"
#include "tests/emulation/hid_cp2110.hpp"

using test::run_until;

namespace {

// UART of a radar board behind an emulated CP2110.
class HidUart final : public sim::Uart {
 public:
  HidUart(port::SystemLoop& loop, const sim::HidOptions& options, unsigned baud, Receive receive)
      : Uart(loop, baud, std::chrono::milliseconds(1)),
        receive_(std::make_shared<Receive>(std::move(receive))),
        bridge(test::bed(), options, [&loop, to = receive_](ByteView bytes) {
          loop.post([to, copy = Bytes(bytes.begin(), bytes.end())] {
            if (*to) (*to)(copy);
          });
        }) {}
  ~HidUart() override { *receive_ = nullptr; }

 private:
  std::size_t deliver(Bytes chunk) override { return bridge.receive(chunk); }

  // Cleared by the destructor, because bytes may still arrive after the object has been destroyed.
  std::shared_ptr<Receive> receive_;

 public:
  sim::HidCp2110 bridge;
};

// Radar board and radar driver that share one event loop.
struct Bench {
  Bench() {
    const auto uart = [this](unsigned number, const char* serial, HidUart*& made) {
      return [this, number, serial, &made](unsigned baud, sim::Uart::Receive receive) {
        auto out = std::make_unique<HidUart>(loop, sim::HidOptions{number, serial}, baud,
                                             std::move(receive));
        made = out.get();
        return out;
      };
    };
    board = sim::make_radar_board(loop, player, {}, uart(0, "CLI", cli), uart(1, "DATA", data));
    const std::string cfg =
        test::contents(test::source_dir + "/config/radar/xwr68xx_paper_50cm.cfg");
    driver = make_radar(loop, {"hid:10c4:ea80:CLI", "hid:10c4:ea80:DATA", cfg, "paper.cfg"});
  }
  auto reported(const std::string& start) const {
    return std::count_if(sink.events.begin(), sink.events.end(),
                         [&](const std::string& text) { return text.starts_with(start); });
  }

  port::SystemLoop loop;
  sim::ScenePlayer player{loop, {}, {}};
  HidUart *cli = nullptr, *data = nullptr;
  std::unique_ptr<sim::Device> board;
  std::unique_ptr<Driver> driver;
  test::KeepingSink sink;
};

}  // namespace

TEST_CASE("the cfg dialogue and radar frames work over two HID ports, even after a reconnection") {
  Bench b;
  b.driver->start(b.sink);
  REQUIRE(run_until(
      b.loop, [&] { return b.sink.radar.size() >= 20; }, std::chrono::seconds(20)));
  CHECK(b.data->bridge.chip().baud() == 921600);
  CHECK(b.sink.state() == DeviceState::streaming);
  // On a busy machine, the board may skip frames. The driver must count each skipped frame as lost.
  CHECK(b.sink.radar[0].frame_number + 19 + test::counter(*b.driver, "lost_frames") ==
        b.sink.radar[19].frame_number);
  CHECK(test::counter(*b.driver, "junk_bytes") == 0);
  CHECK(test::counter(*b.driver, "port_losses") == 0);
  CHECK(b.reported("hid:10c4:ea80:DATA: 921600 baud") == 1);
  CHECK(b.reported("hid:") == 1);

  b.data->bridge.unplug();
  REQUIRE(run_until(b.loop, [&] { return b.sink.state() == DeviceState::faulted; }));
  const std::size_t before = b.sink.radar.size();
  b.data->bridge.plug();
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

TEST_CASE("a receive overrun in a radar stream over HID is reported and counted") {
  Bench b;
  b.driver->start(b.sink);
  REQUIRE(run_until(
      b.loop, [&] { return b.sink.radar.size() >= 2; }, std::chrono::seconds(20)));
  b.data->bridge.receive(Bytes(900, 0x55));
  REQUIRE(run_until(b.loop, [&] { return test::counter(*b.driver, "port_losses") > 0; }));
  CHECK(b.reported("hid:10c4:ea80:DATA: overrun: the bridge lost bytes") == 1);
  const std::size_t before = b.sink.radar.size();
  REQUIRE(run_until(b.loop, [&] { return b.sink.radar.size() >= before + 20; }));
  CHECK(test::counter(*b.driver, "connections") == 1);
  b.driver->stop();
  b.board->stop();
}

// SPDX-License-Identifier: MIT
#include "tests/emulation/tdc_usb.hpp"

#include <atomic>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>

#include "sim/devices/tag_stream.hpp"
#include "sim/wire/encode.hpp"

namespace echofuse::sim {
namespace {

constexpr auto tick = std::chrono::milliseconds(5);
constexpr auto hello_pause = std::chrono::milliseconds(900);
constexpr char hello[] =
    R"({"model":"simulated USB time tagger","serial":"SIM-USB-1","firmware":"1.0"})";

class Tagger final : public Device {
 public:
  Tagger(port::SystemLoop& loop, ScenePlayer& player, UsbBed& bed, const TdcOptions& options)
      : fifo_bytes_(options.send_queue_bytes),
        stream_(player, options),
        loop_(loop),
        timer_(loop),
        usb_(bed,
             {0x1209, 1, 0x0102, "echofuse", "simulated USB time tagger", "SIM-USB-1", 0x45, 1},
             [this](const UsbDevice::Setup& setup) { return control(setup); }) {
    usb_.plug();
    wait();
  }

  void stop() override {
    timer_.cancel();
    wanted_ = false;
  }

  std::vector<std::pair<std::string, std::uint64_t>> sent() const override {
    return {{"tags", tags_}, {"lost", lost_}, {"starts", starts_}};
  }

 private:
  // Answers vendor requests on umockdev's thread. Request 1 starts the tagger, and request 2 stops
  // the tagger.
  std::optional<Bytes> control(const UsbDevice::Setup& setup) {
    if (setup.request != 1 && setup.request != 2) return std::nullopt;
    wanted_ = restart_ = setup.request == 1;
    usb_.clear();
    return Bytes{};
  }

  void wait() {
    timer_.after(tick, [this] {
      if (wanted_) run();
      wait();
    });
  }

  void run() {
    if (restart_.exchange(false)) {
      stream_.start();
      tags_ = lost_ = dropped_ = 0;
      sequence_ = 0;
      next_hello_ = {};
      ++starts_;
    }
    Bytes run;
    if (loop_.now() >= next_hello_) {
      next_hello_ = loop_.now() + hello_pause;
      put_block(run, BlockKind::hello, Bytes(std::begin(hello), std::end(hello) - 1));
    }
    const auto lose = [this](std::uint64_t tags) {
      lost_ += tags;
      dropped_ += tags;
    };
    stream_.advance(
        [&](ByteView tags, std::size_t count) {
          if (usb_.waiting() + run.size() + tags.size() > fifo_bytes_) return lose(count);
          put_block(run, BlockKind::tags, tags);
          tags_ += count;
        },
        lose);
    if (!restart_) usb_.send(run);
  }

  void put_block(Bytes& run, BlockKind kind, ByteView payload) {
    const Bytes block = bridge_block(kind, sequence_++, std::exchange(dropped_, 0), payload);
    run.insert(run.end(), block.begin(), block.end());
  }

  std::size_t fifo_bytes_;
  TagStream stream_;
  port::Loop& loop_;
  port::Timer timer_;
  std::uint32_t sequence_ = 0;
  HostTime next_hello_{};
  std::uint64_t starts_ = 0, tags_ = 0, lost_ = 0, dropped_ = 0;
  // Both flags are written by the control handler, which runs on another thread.
  std::atomic<bool> wanted_{false}, restart_{false};
  UsbDevice usb_;  // must be the last member, because its thread uses the other members
};

}  // namespace

std::unique_ptr<Device> make_tdc_usb(port::SystemLoop& loop, ScenePlayer& player, UsbBed& bed,
                                     const TdcOptions& options) {
  return std::make_unique<Tagger>(loop, player, bed, options);
}

}  // namespace echofuse::sim

// SPDX-License-Identifier: MIT
#include "tests/emulation/tdc_usb.hpp"

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstring>
#include <limits>
#include <map>

#include "drivers/core/sample.hpp"
#include "sim/devices/tag_stream.hpp"

namespace echofuse::sim {
namespace {

constexpr auto tick = std::chrono::milliseconds(5);
constexpr std::size_t tag_bytes = 16;

class Tagger final : public TdcUsb {
 public:
  Tagger(boost::asio::io_context& io, ScenePlayer& player, UsbBed& bed, const TdcOptions& options)
      : fifo_bytes_(options.send_queue_bytes),
        stream_(player, options),
        timer_(io),
        usb_(bed,
             {.vendor = vendor,
              .product = product,
              .release_bcd = 0x0102,
              .manufacturer = "echofuse",
              .name = "simulated USB time tagger",
              .serial = "SIM-USB-1",
              .interface_subclass = 0x45,
              .interface_protocol = 0x01},
             [this](const UsbDevice::Setup& setup) { return control(setup); }) {
    usb_.plug();
    wait();
  }

  std::string address() const override { return "usb:1209:0001:SIM-USB-1"; }
  UsbDevice& usb() override { return usb_; }

  void stop() override {
    timer_.cancel();
    wanted_ = false;
  }

  std::vector<std::pair<std::string, std::uint64_t>> sent() const override {
    return {{"tags", tags_}, {"lost", lost_}, {"starts", starts_}};
  }

 private:
  // Vendor requests, on umockdev's thread: 1 info, 2 status, 3 start, 4 stop.
  std::optional<Bytes> control(const UsbDevice::Setup& setup) {
    Bytes answer;
    switch (setup.request) {
      case 1:
        put(answer, std::uint16_t{1});
        put(answer, std::uint16_t{tag_bytes});
        put(answer, static_cast<std::uint32_t>(fifo_bytes_ / tag_bytes));
        put(answer, std::uint64_t{0});
        return answer;
      case 2:
        put(answer, std::uint32_t{(wanted_ ? 1u : 0u) | (losing_ ? 2u : 0u)});
        put(answer, std::uint32_t{0});
        put(answer, tags_.load());
        put(answer, lost_.load());
        return answer;
      case 3:
        restart_ = true;
        wanted_ = true;
        return answer;
      case 4:
        wanted_ = false;
        return answer;
      default:
        return std::nullopt;
    }
  }

  void wait() {
    timer_.expires_after(tick);
    timer_.async_wait([this](const boost::system::error_code& error) {
      if (error) return;
      if (wanted_) run();
      wait();
    });
  }

  void run() {
    if (restart_.exchange(false)) {
      usb_.clear();
      stream_.start();
      tags_ = lost_ = 0;
      missed_.clear();
      losing_ = false;
      ++starts_;
    }
    Bytes run;
    stream_.advance(
        [&](ByteView tags, std::size_t count) {
          if (usb_.waiting() + run.size() + tags.size() > fifo_bytes_) return lose(tags, count);
          end_overflow(run);
          run.insert(run.end(), tags.begin(), tags.end());
          last_ps_ = last_time(tags, last_ps_);
          tags_ += count;
        },
        [&](std::uint64_t tags) {
          lost_ += tags;
          losing_ = true;
        });
    usb_.send(run);  // be it empty: a sign of life
  }

  static std::int64_t last_time(ByteView tags, std::int64_t before) {
    if (tags.size() < tag_bytes) return before;
    std::int64_t time = 0;
    std::memcpy(&time, tags.data() + tags.size() - sizeof time, sizeof time);
    return time;
  }

  void lose(ByteView tags, std::size_t count) {
    lost_ += count;
    losing_ = true;
    for (std::size_t at = 0; at + tag_bytes <= tags.size(); at += tag_bytes) {
      std::int32_t channel = 0;
      std::memcpy(&channel, tags.data() + at + 4, sizeof channel);
      ++missed_[channel];
    }
  }

  void marker(Bytes& run, TagType type, std::int32_t channel, std::uint16_t missed) {
    Tag tag;
    tag.type = type;
    tag.missed_events = missed;
    tag.channel = channel;
    tag.time_ps = last_ps_;
    put(run, tag);
    ++tags_;
  }

  // There is room again: first what was lost.
  void end_overflow(Bytes& run) {
    if (!losing_.exchange(false)) return;
    marker(run, TagType::overflow_begin, 0, 0);
    for (auto& [channel, count] : missed_)
      while (count > 0) {
        const auto some = static_cast<std::uint16_t>(
            std::min<std::uint64_t>(count, std::numeric_limits<std::uint16_t>::max()));
        marker(run, TagType::missed_events, channel, some);
        count -= some;
      }
    marker(run, TagType::overflow_end, 0, 0);
  }

  std::size_t fifo_bytes_;
  TagStream stream_;
  boost::asio::steady_timer timer_;
  std::map<std::int32_t, std::uint64_t> missed_;
  std::int64_t last_ps_ = 0;
  std::uint64_t starts_ = 0;
  // Seen by the control handler too:
  std::atomic<bool> wanted_{false}, restart_{false}, losing_{false};
  std::atomic<std::uint64_t> tags_{0}, lost_{0};
  UsbDevice usb_;  // last: its thread uses the rest
};

}  // namespace

std::unique_ptr<TdcUsb> make_tdc_usb(boost::asio::io_context& io, ScenePlayer& player, UsbBed& bed,
                                     const TdcOptions& options) {
  return std::make_unique<Tagger>(io, player, bed, options);
}

}  // namespace echofuse::sim

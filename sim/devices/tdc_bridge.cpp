// SPDX-License-Identifier: MIT
#include <cmath>
#include <cstring>

#include "sim/devices/block_server.hpp"
#include "sim/devices/tag_stream.hpp"

namespace echofuse::sim {
namespace {

constexpr std::size_t tag_time_offset = 8;
constexpr char hello[] =
    R"({"model":"simulated time tagger","serial":"SIM-TDC-1","firmware":"1.0"})";

class Bridge final : public Device {
 public:
  Bridge(port::Loop& loop, ScenePlayer& player, const TdcOptions& options,
         std::unique_ptr<Listener> listener)
      : options_(options),
        stream_(player, options),
        listener_(std::move(listener)),
        timer_(loop),
        injector_(loop, player, "tdc", options.plan, options.seed, [this] { server_.poll(); }),
        zero_(player.start()),
        server_(*listener_, injector_, hello, options.send_queue_bytes,
                {.connected = [this] { stream_.start(); },
                 .log = [this](auto time, auto what, auto block) { log(time, what, block); }}) {
    wait();
  }

  void stop() override {
    timer_.cancel();
    injector_.stop();
    server_.stop();
  }

  std::vector<std::pair<std::string, std::uint64_t>> sent() const override {
    return {{"clients", server_.clients()},
            {"blocks", server_.sent_blocks()},
            {"tags", server_.sent_items()},
            {"dropped", dropped_}};
  }

 private:
  void wait() {
    timer_.after(options_.tick, [this] {
      server_.greet_again();
      stream_.set_gain(injector_.gain());
      if (server_.connected())
        stream_.advance([this](ByteView tags, std::size_t count) { send(tags, count); },
                        [this](std::uint64_t tags) { drop(tags); });
      wait();
    });
  }

  void send(ByteView tags, std::size_t count) {
    Bytes payload(tags.begin(), tags.end());
    HostTime first = injector_.now(), last = first;
    for (std::size_t i = 0; i < count; ++i) (i == 0 ? first : last) = set_clock(payload, i);
    if (!server_.put({.kind = BlockKind::tags,
                      .bytes = std::move(payload),
                      .items = count,
                      .first = first,
                      .last = last}))
      drop(count);
  }

  // Converts the time of tag i to the device clock. Returns the host time of the tag.
  HostTime set_clock(Bytes& payload, std::size_t i) const {
    std::uint8_t* const place = payload.data() + i * tag_bytes + tag_time_offset;
    std::int64_t ps = 0;
    std::memcpy(&ps, place, sizeof ps);
    const HostTime time = zero_ + std::chrono::nanoseconds(ps / 1000);
    ps += std::llround(1e12 * injector_.clock_error_s(static_cast<double>(ps) * 1e-12));
    std::memcpy(place, &ps, sizeof ps);
    return time;
  }

  void drop(std::uint64_t tags) {
    server_.lose(tags);
    dropped_ += tags;
    injector_.log(injector_.now(), "overrun", {{"tags", static_cast<std::int64_t>(tags)}});
  }

  void log(HostTime time, const char* what, const BlockServer::QueuedBlock* block) {
    if (!block) return injector_.log(time, what, {});
    injector_.log(time, what,
                  {{"seq", block->sequence},
                   {"kind", static_cast<int>(block->kind)},
                   {"damage", block->damage},
                   {"tags", static_cast<std::int64_t>(block->items)},
                   {"first", block->first.count()},
                   {"last", block->last.count()}});
  }

  TdcOptions options_;
  TagStream stream_;
  std::unique_ptr<Listener> listener_;
  port::Timer timer_;
  FaultInjector injector_;
  HostTime zero_;  // host time at which the tag clock is zero
  std::uint64_t dropped_ = 0;
  BlockServer server_;
};

}  // namespace

std::unique_ptr<Device> make_tdc_bridge(port::Loop& loop, ScenePlayer& player,
                                        const TdcOptions& options,
                                        std::unique_ptr<Listener> listener) {
  return std::make_unique<Bridge>(loop, player, options, std::move(listener));
}

}  // namespace echofuse::sim

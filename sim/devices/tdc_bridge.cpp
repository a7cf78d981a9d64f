// SPDX-License-Identifier: MIT
#include <cmath>
#include <cstring>
#include <deque>

#include "sim/devices/fault_injector.hpp"
#include "sim/devices/listener.hpp"
#include "sim/devices/tag_stream.hpp"
#include "sim/wire/encode.hpp"

namespace echofuse::sim {
namespace {

constexpr std::size_t tag_time_offset = 8;
constexpr auto hello_pause = std::chrono::milliseconds(900);
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
        injector_(loop, player, "tdc", options.plan, options.seed, [this] { poll(); }),
        zero_(player.start()) {
    listener_->start(
        {.connected = [this] { begin(); }, .left = [this] { disconnect("client left"); }});
    listener_->accept();
    wait();
  }

  void stop() override {
    stopping_ = true;
    timer_.cancel();
    injector_.stop();
    if (listener_->plugged()) listener_->plug(false);
    if (connected_) enqueue(BlockKind::bye, {}, 0);
  }

  std::vector<std::pair<std::string, std::uint64_t>> sent() const override {
    return {{"clients", clients_}, {"blocks", blocks_}, {"tags", tags_}, {"dropped", all_dropped_}};
  }

 private:
  struct Block {
    Bytes bytes;
    const char* what;  // fate of the block, if all goes well from here on
    BlockKind kind;
    std::uint32_t sequence;
    std::size_t tags;
    HostTime first, last;  // host times of its tags
    HostTime due, begun{};
    std::int64_t damage = -1;  // index of the damaged byte; -1: none
  };

  void begin() {
    connected_ = true;
    ++clients_;
    injector_.log(injector_.now(), "connected", {});
    sequence_ = 0;
    dropped_ = 0;
    stream_.start();
    greet();
  }

  void greet() {
    enqueue(BlockKind::hello, Bytes(std::begin(hello), std::end(hello) - 1), 0);
    next_hello_ = injector_.now() + hello_pause;
  }

  void disconnect(const char* why) {
    if (!connected_) return;
    connected_ = false;
    injector_.log(injector_.now(), why, {});
    listener_->hang_up();
    if (!writing_) next_client();
  }

  // It is called only after the last write of the former client has ended: its buffers are in the
  // queue.
  void next_client() {
    for (const Block& block : queue_) log(block, block.begun == HostTime{} ? "unsent" : "cut");
    queue_.clear();
    queued_bytes_ = 0;
    if (!stopping_) listener_->accept();
  }

  // When it is unplugged, nobody listens at the port.
  void poll() {
    if (stopping_) return;
    if (const bool in = !injector_.active(FaultKind::unplug); in != listener_->plugged()) {
      listener_->plug(in);
      if (!in) disconnect("unplugged");
    }
    if (!queue_.empty() && !writing_ && connected_) write();
  }

  void wait() {
    timer_.after(options_.tick, [this] {
      if (connected_ && injector_.now() > next_hello_) greet();
      stream_.set_gain(injector_.gain());
      if (connected_)
        stream_.advance(
            [this](ByteView tags, std::size_t count) {
              enqueue(BlockKind::tags, Bytes(tags.begin(), tags.end()), count);
            },
            [this](std::uint64_t tags) { drop(tags); });
      wait();
    });
  }

  void enqueue(BlockKind kind, Bytes payload, std::size_t tags) {
    if (queued_bytes_ + payload.size() > options_.send_queue_bytes) return drop(tags);
    Block block{.bytes = {},
                .what = "sent",
                .kind = kind,
                .sequence = sequence_++,
                .tags = tags,
                .first = injector_.now(),
                .last = injector_.now(),
                .due = injector_.due()};
    if (tags > 0) {
      block.first = set_clock(payload, 0);
      for (std::size_t i = 1; i < tags; ++i) block.last = set_clock(payload, i);
    }
    block.bytes = bridge_block(kind, block.sequence, std::exchange(dropped_, 0), payload);
    if (injector_.triggers(FaultKind::drop)) return log(block, "dropped");
    if (injector_.triggers(FaultKind::corrupt)) {
      block.damage = static_cast<std::int64_t>(injector_.corrupt(block.bytes));
      block.what = "corrupt";
    }
    if (const Bytes junk = injector_.garbage(); !junk.empty()) {
      block.bytes.insert(block.bytes.begin(), junk.begin(), junk.end());
      block.what = "garbage";
    }
    queued_bytes_ += block.bytes.size();
    queue_.push_back(std::move(block));
    if (!writing_) write();
  }

  // It puts tag number i on the device's clock, and returns the host's time of it.
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
    dropped_ += tags;
    all_dropped_ += tags;
    injector_.log(injector_.now(), "overrun", {{"tags", static_cast<std::int64_t>(tags)}});
  }

  void log(const Block& block, const char* what) {
    const HostTime begun = block.begun == HostTime{} ? injector_.now() : block.begun;
    injector_.log(begun, what,
                  {{"seq", block.sequence},
                   {"kind", static_cast<int>(block.kind)},
                   {"damage", block.damage},
                   {"tags", static_cast<std::int64_t>(block.tags)},
                   {"first", block.first.count()},
                   {"last", block.last.count()}});
  }

  // It does not write while the line stands still, nor before the block's time: poll() comes back
  // to it.
  void write() {
    Block& next = queue_.front();
    if (injector_.active(FaultKind::stall) || injector_.now() < next.due) return;
    next.begun = injector_.now();
    writing_ = true;
    listener_->write(next.bytes, [this](bool whole) {
      writing_ = false;
      written(whole);
    });
  }

  void written(bool whole) {
    if (whole) sent();  // the block is whole, also when the connection was closed since
    if (!connected_) return next_client();
    if (!whole) return disconnect("client left");
    if (!queue_.empty())
      write();
    else if (stopping_)
      disconnect("closed");
  }

  void sent() {
    log(queue_.front(), queue_.front().what);
    ++blocks_;
    tags_ += queue_.front().tags;
    queued_bytes_ -= queue_.front().bytes.size();
    queue_.pop_front();
  }

  TdcOptions options_;
  TagStream stream_;
  std::unique_ptr<Listener> listener_;
  port::Timer timer_;
  FaultInjector injector_;
  HostTime zero_;  // zero of the tags' clock
  std::deque<Block> queue_;
  std::size_t queued_bytes_ = 0;
  bool connected_ = false, writing_ = false, stopping_ = false;
  std::uint32_t sequence_ = 0;
  HostTime next_hello_{};
  std::uint64_t dropped_ = 0, all_dropped_ = 0, clients_ = 0, blocks_ = 0, tags_ = 0;
};

}  // namespace

std::unique_ptr<Device> make_tdc_bridge(port::Loop& loop, ScenePlayer& player,
                                        const TdcOptions& options,
                                        std::unique_ptr<Listener> listener) {
  return std::make_unique<Bridge>(loop, player, options, std::move(listener));
}

}  // namespace echofuse::sim

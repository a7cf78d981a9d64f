// SPDX-License-Identifier: MIT
#include "drivers/depth/openni_camera.hpp"

#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include "drivers/bridge/bridge_writer.hpp"
#include "drivers/depth/openni_session.hpp"
#include "drivers/port/raw_tap.hpp"

namespace echofuse::depth {
namespace {

using namespace std::chrono_literals;

constexpr auto wait_limit = 100ms;
// a live camera is reopened after this time without a complete frame
constexpr auto silence_limit = 3s;
// a recording of unknown length ends after this time without a frame
constexpr auto recording_end = 1s;
constexpr int max_queued = 4;

}  // namespace

// The camera's thread. It keeps this object alive. Threading: start(), stop(), finished() and
// join() run on the loop's thread, all other functions on the camera's thread.
class OpenNiCamera::Capture : public std::enable_shared_from_this<Capture> {
 public:
  Capture(port::Loop& loop, const std::string& address, std::string uri, OpenNiOptions options,
          port::RawKeeper* raw)
      : loop_(loop), uri_(std::move(uri)), options_(options), raw_(raw), backoff_(options.backoff) {
    info_.sensor = Sensor::depth;
    info_.address = address;
  }

  void start(SampleSink& to) {
    sink_ = &to;
    to.on_state(info_.sensor, DeviceState::connecting, info_);
    thread_ = loop_.make_worker();
    thread_->put([self = shared_from_this()] {
      self->run();
      self->loop_.post([self] {
        self->ended_ = true;
        self->sink_ = nullptr;
      });
    });
  }
  // Asks the camera's thread to end, and wakes it from pause(). Actions that have already been
  // posted still run.
  void stop() {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    wake_.notify_all();
  }
  bool finished() const { return ended_ || !thread_; }
  // Stops and joins the camera's thread. Discards posted actions.
  void join() {
    stop();
    sink_ = nullptr;
    thread_.reset();
  }

  std::atomic<std::uint64_t> frames{0}, lost_frames{0}, dropped_frames{0}, bad_frames{0},
      connections{0};

 private:
  using Read = OpenNiSession::Read;

  // Runs sessions until the driver is stopped, with a pause after each failure.
  void run() {
    do {
      const std::string why = run_session();
      if (stopping_) return;
      if (why.empty()) return report(DeviceState::ended);
      if (backoff_.is_news(why))
        post([why](SampleSink& to) { to.on_event(Sensor::depth, Severity::warning, why); });
      report(DeviceState::faulted);
    } while (pause(backoff_.next()));
  }
  // Reports the state if it has changed since the last report.
  void report(DeviceState now) {
    if (std::exchange(state_, now) == now) return;
    post([now, info = info_](SampleSink& to) { to.on_state(info.sensor, now, info); });
  }
  // Runs the action on the loop's thread and passes the driver's sink to it.
  void post(std::function<void(SampleSink&)> action) {
    loop_.post([self = shared_from_this(), action = std::move(action)] {
      if (self->sink_) action(*self->sink_);
    });
  }
  // Waits for the given time. Returns false if the driver has been stopped.
  bool pause(std::chrono::nanoseconds time) {
    std::unique_lock lock(mutex_);
    return !wake_.wait_for(lock, time, [this] { return stopping_.load(); });
  }

  // Runs one session. Returns the reason why the camera failed, or an empty string at the end of a
  // recording.
  std::string run_session() {
    OpenNiSession session;
    if (std::string wrong = session.open(uri_, options_); !wrong.empty()) return wrong;
    ++connections;
    rejoined_ = last_index_.has_value();
    pace_.reset();
    const std::string address = info_.address;
    info_ = session.info();
    info_.address = address;
    raw_name_.clear();
    report(DeviceState::streaming);
    auto last_frame = std::chrono::steady_clock::now();
    while (!stopping_) {
      DepthFrame frame;
      const Read read = session.read(wait_limit, frame);
      const auto now = std::chrono::steady_clock::now();
      if (read == Read::end) return {};
      if (read == Read::disconnected) return "camera disconnected";
      if (read == Read::bad_frame) ++bad_frames;
      if (read == Read::frame) {
        backoff_.alive(loop_.now());
        deliver(std::move(frame), session.recording());
        last_frame = now;
      }
      if (session.recording() && now - last_frame > recording_end) return {};
      if (now - last_frame > silence_limit) return "the camera sent no complete frame for 3 s";
    }
    return {};
  }

  void deliver(DepthFrame frame, bool recording) {
    if (recording && !hold_back(frame.device_time_us)) return;
    frame.received = loop_.now();
    frame.lost_before = lost_before(frame.frame_number);
    last_index_ = frame.frame_number;
    lost_frames += frame.lost_before;
    keep(frame);
    if (queued_ >= max_queued) {
      ++dropped_frames;
      dropped_since_ += 1 + frame.lost_before;
      return;
    }
    frame.lost_before += std::exchange(dropped_since_, 0);
    ++queued_;
    ++frames;
    auto held = std::make_shared<DepthFrame>(std::move(frame));
    post([this, held](SampleSink& sink) {
      --queued_;
      sink.on_depth(std::move(*held));
    });
  }

  // Returns the number of frames missing before `index`, according to the camera's frame indices.
  // Many cameras continue to count frames while they are closed. If a reopened camera has restarted
  // its count, at least one frame was lost.
  std::uint32_t lost_before(std::uint32_t index) {
    const bool rejoined = std::exchange(rejoined_, false);
    if (last_index_ && index > *last_index_) return index - *last_index_ - 1;
    return rejoined;
  }

  // Stores the frame in the raw capture. Each session has its own file, which starts with a hello
  // block.
  void keep(const DepthFrame& frame) {
    if (!raw_) return;
    using bridge::BlockKind;
    if (raw_name_.empty()) {
      raw_name_ = raw_->next_name("depth", ".blocks");
      for (const char* what : {"open", "opened"}) raw_->note("depth", frame.received, what);
      keep(bridge::make_block(BlockKind::hello, 0, 0, bridge::hello_payload(info_)),
           frame.received);
      raw_sequence_ = 0;
    }
    keep(bridge::make_block(BlockKind::depth, ++raw_sequence_, frame.lost_before,
                            bridge::depth_payload(frame, info_.axes[0], info_.axes[1])),
         frame.received);
  }
  void keep(const Bytes& block, HostTime at) {
    if (raw_->put(raw_name_, block))
      raw_->note("depth", at, "bytes", static_cast<std::int64_t>(block.size()));
  }

  // Waits until a recording's frame is due and the queue has space. Returns false if the driver has
  // been stopped.
  bool hold_back(std::uint64_t device_time_us) {
    const auto now = std::chrono::steady_clock::now();
    if (!pace_) pace_ = {now, device_time_us};
    const auto due = pace_->first + std::chrono::microseconds(
                                        static_cast<std::int64_t>(device_time_us - pace_->second));
    if (options_.paced && due > now && !pause(std::min<std::chrono::nanoseconds>(due - now, 1s)))
      return false;
    while (queued_ >= max_queued)
      if (!pause(1ms)) return false;
    return true;
  }

  port::Loop& loop_;
  SampleSink* sink_ = nullptr;  // used on the loop's thread only
  bool ended_ = false;          // used on the loop's thread only
  std::unique_ptr<port::Worker> thread_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::atomic<bool> stopping_{false};
  std::atomic<int> queued_{0};
  DeviceState state_ = DeviceState::connecting;
  std::string uri_;
  OpenNiOptions options_;
  port::RawKeeper* raw_;
  std::string raw_name_;
  std::uint32_t raw_sequence_ = 0;
  DeviceInfo info_;
  port::Backoff backoff_;
  std::optional<std::uint32_t> last_index_;
  bool rejoined_ = false;  // true from the reopening of the camera until its first frame arrives
  std::uint32_t dropped_since_ = 0;
  std::optional<std::pair<std::chrono::steady_clock::time_point, std::uint64_t>> pace_;
};

OpenNiCamera::OpenNiCamera(port::Loop& loop, const std::string& address, const std::string& uri,
                           OpenNiOptions options, port::RawKeeper* raw)
    : capture_(std::make_shared<Capture>(loop, address, uri, options, raw)) {
  initialize_openni();
}

OpenNiCamera::~OpenNiCamera() { capture_->join(); }

void OpenNiCamera::start(SampleSink& sink) { capture_->start(sink); }

void OpenNiCamera::stop() { capture_->stop(); }

bool OpenNiCamera::finished() const { return capture_->finished(); }

std::vector<Counter> OpenNiCamera::counters() const {
  return {{"frames", capture_->frames},
          {"lost_frames", capture_->lost_frames},
          {"dropped_frames", capture_->dropped_frames},
          {"bad_frames", capture_->bad_frames},
          {"connections", capture_->connections}};
}

}  // namespace echofuse::depth

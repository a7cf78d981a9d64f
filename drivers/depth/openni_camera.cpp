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

// State shared by the loop's thread and the camera's thread. Threading: start(), stop(), finished()
// and join() run on the loop's thread, all other functions on the camera's thread.
struct OpenNiCamera::Shared : std::enable_shared_from_this<Shared> {
  explicit Shared(port::Loop& l) : loop(l) {}

  void start(SampleSink& to, const DeviceInfo& info, std::function<void()> work) {
    sink = &to;
    to.on_state(info.sensor, DeviceState::connecting, info);
    thread = loop.make_worker();
    thread->put([self = shared_from_this(), work = std::move(work)] {
      work();
      self->loop.post([self] {
        self->ended = true;
        self->sink = nullptr;
      });
    });
  }
  // Asks the camera's thread to end, and wakes it from pause(). Actions that have already been
  // posted still run.
  void stop() {
    const std::lock_guard lock(mutex);
    stopping = true;
    wake.notify_all();
  }
  bool finished() const { return ended || !thread; }
  // Stops and joins the camera's thread. Discards posted actions.
  void join() {
    stop();
    sink = nullptr;
    thread.reset();
  }

  // Runs sessions until the driver is stopped, with a pause after each failure. `session` returns
  // the reason why the camera failed, or an empty string at the end of a recording. `info`
  // describes the camera used in the current session.
  void run(const DeviceInfo& info, port::Backoff& backoff,
           const std::function<std::string()>& session) {
    do {
      const std::string why = session();
      if (stopping) return;
      if (why.empty()) return report(info, DeviceState::ended);
      if (backoff.is_news(why))
        post([why](SampleSink& to) { to.on_event(Sensor::depth, Severity::warning, why); });
      report(info, DeviceState::faulted);
    } while (pause(backoff.next()));
  }
  // Reports the state if it has changed since the last report.
  void report(const DeviceInfo& info, DeviceState now) {
    if (std::exchange(state, now) == now) return;
    post([now, info](SampleSink& to) { to.on_state(info.sensor, now, info); });
  }
  // Runs the action on the loop's thread and passes the driver's sink to it.
  void post(std::function<void(SampleSink&)> action) {
    loop.post([self = shared_from_this(), action = std::move(action)] {
      if (self->sink) action(*self->sink);
    });
  }
  // Waits for the given time. Returns false if the driver has been stopped.
  bool pause(std::chrono::nanoseconds time) {
    std::unique_lock lock(mutex);
    return !wake.wait_for(lock, time, [this] { return stopping.load(); });
  }

  port::Loop& loop;
  SampleSink* sink = nullptr;  // used on the loop's thread only
  bool ended = false;          // used on the loop's thread only
  std::unique_ptr<port::Worker> thread;
  DeviceState state = DeviceState::connecting;  // used on the camera's thread only
  std::mutex mutex;
  std::condition_variable wake;
  std::atomic<bool> stopping{false};
  std::atomic<int> queued{0};
  std::atomic<std::uint64_t> frames{0}, lost_frames{0}, dropped_frames{0}, bad_frames{0},
      connections{0};
};

// Captures frames. run() and the functions that it calls run on the camera's thread.
class OpenNiCamera::CaptureThread {
 public:
  CaptureThread(std::shared_ptr<Shared> shared, DeviceInfo info, std::string uri,
                const Clock& clock, OpenNiOptions options, port::RawKeeper* raw)
      : shared_(std::move(shared)),
        uri_(std::move(uri)),
        clock_(clock),
        options_(options),
        raw_(raw),
        info_(std::move(info)),
        backoff_(options.backoff) {}

  void run() {
    shared_->run(info_, backoff_, [this] { return run_session(); });
  }

 private:
  using Read = OpenNiSession::Read;

  // Runs one session. Returns the reason why the camera failed, or an empty string at the end of a
  // recording.
  std::string run_session() {
    OpenNiSession session;
    if (std::string wrong = session.open(uri_, options_); !wrong.empty()) return wrong;
    ++shared_->connections;
    rejoined_ = last_index_.has_value();
    pace_.reset();
    const std::string address = info_.address;
    info_ = session.info();
    info_.address = address;
    raw_name_.clear();
    shared_->report(info_, DeviceState::streaming);
    auto last_frame = std::chrono::steady_clock::now();
    while (!shared_->stopping) {
      DepthFrame frame;
      const Read read = session.read(wait_limit, frame);
      const auto now = std::chrono::steady_clock::now();
      if (read == Read::end) return {};
      if (read == Read::disconnected) return "camera disconnected";
      if (read == Read::bad_frame) ++shared_->bad_frames;
      if (read == Read::frame) {
        backoff_.alive(clock_.now());
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
    frame.received = clock_.now();
    frame.lost_before = lost_before(frame.frame_number);
    last_index_ = frame.frame_number;
    shared_->lost_frames += frame.lost_before;
    keep(frame);
    if (shared_->queued >= max_queued) {
      ++shared_->dropped_frames;
      dropped_since_ += 1 + frame.lost_before;
      return;
    }
    frame.lost_before += std::exchange(dropped_since_, 0);
    ++shared_->queued;
    ++shared_->frames;
    auto held = std::make_shared<DepthFrame>(std::move(frame));
    shared_->post([shared = shared_, held](SampleSink& sink) {
      --shared->queued;
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
    if (options_.paced && due > now &&
        !shared_->pause(std::min<std::chrono::nanoseconds>(due - now, 1s)))
      return false;
    while (shared_->queued >= max_queued)
      if (!shared_->pause(1ms)) return false;
    return true;
  }

  std::shared_ptr<Shared> shared_;
  std::string uri_;
  const Clock& clock_;
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

OpenNiCamera::OpenNiCamera(port::Loop& loop, std::string address, std::string uri,
                           OpenNiOptions options, port::RawKeeper* raw)
    : shared_(std::make_shared<Shared>(loop)),
      address_(std::move(address)),
      uri_(std::move(uri)),
      loop_(loop),
      options_(options),
      raw_(raw) {
  initialize_openni();
}

OpenNiCamera::~OpenNiCamera() { shared_->join(); }

void OpenNiCamera::start(SampleSink& sink) {
  DeviceInfo info;
  info.sensor = Sensor::depth;
  info.address = address_;
  const auto worker = std::make_shared<CaptureThread>(shared_, info, uri_, loop_, options_, raw_);
  shared_->start(sink, info, [worker] { worker->run(); });
}

void OpenNiCamera::stop() { shared_->stop(); }

bool OpenNiCamera::finished() const { return shared_->finished(); }

std::vector<Counter> OpenNiCamera::counters() const {
  return {{"frames", shared_->frames},
          {"lost_frames", shared_->lost_frames},
          {"dropped_frames", shared_->dropped_frames},
          {"bad_frames", shared_->bad_frames},
          {"connections", shared_->connections}};
}

}  // namespace echofuse::depth

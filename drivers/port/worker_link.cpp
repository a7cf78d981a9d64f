// SPDX-License-Identifier: MIT
#include "drivers/port/worker_link.hpp"

#include <utility>

namespace echofuse::port {

WorkerLink::WorkerLink(Loop& loop) : loop_(loop) {}
WorkerLink::~WorkerLink() = default;

void WorkerLink::start(SampleSink& sink, const DeviceInfo& info, std::function<void()> work) {
  sink_ = &sink;
  sink.on_state(info.sensor, DeviceState::connecting, info);
  thread_ = std::thread([self = shared_from_this(), work = std::move(work)] {
    work();
    self->loop_.post([self] {
      self->finished_ = true;
      self->sink_ = nullptr;
    });
  });
}

void WorkerLink::stop() {
  const std::lock_guard lock(mutex_);
  stopping_ = true;
  wake_.notify_all();
}

void WorkerLink::join() {
  stop();
  sink_ = nullptr;
  if (thread_.joinable()) thread_.join();
}

void WorkerLink::run(const DeviceInfo& info, Backoff& backoff,
                     const std::function<std::string()>& session) {
  do {
    const std::string why = session();
    if (stopping_) return;
    if (why.empty()) return report(info, DeviceState::ended);
    if (backoff.is_news(why))
      post([sensor = info.sensor, why](SampleSink& sink) {
        sink.on_event(sensor, Severity::warning, why);
      });
    report(info, DeviceState::faulted);
  } while (pause(backoff.next()));
}

void WorkerLink::report(const DeviceInfo& info, DeviceState state) {
  if (std::exchange(state_, state) == state) return;
  post([state, info](SampleSink& sink) { sink.on_state(info.sensor, state, info); });
}

void WorkerLink::post(std::function<void(SampleSink&)> action) {
  loop_.post([self = shared_from_this(), action = std::move(action)] {
    if (self->sink_) action(*self->sink_);
  });
}

bool WorkerLink::pause(std::chrono::nanoseconds time) {
  std::unique_lock lock(mutex_);
  return !wake_.wait_for(lock, time, [this] { return stopping_.load(); });
}

}  // namespace echofuse::port

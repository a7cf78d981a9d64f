// SPDX-License-Identifier: MIT
// A driver's own thread, which has sessions with its device, and what it shares with the loop.
#pragma once
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "drivers/core/driver.hpp"
#include "drivers/port/backoff.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::port {

// Threading: start(), stop(), finished() and join() on the loop's thread; the others on the
// worker's.
class WorkerLink : public std::enable_shared_from_this<WorkerLink> {
 public:
  explicit WorkerLink(Loop& loop);
  ~WorkerLink();

  // Reports that the device is looked for, and starts the worker with this.
  void start(SampleSink& sink, const DeviceInfo& info, std::function<void()> work);
  // Asks the worker to end: pauses end, what it posts is still carried out.
  void stop();
  // All that the worker posted was carried out, or it was never started.
  bool finished() const { return finished_ || !thread_.joinable(); }
  // Stops, and waits for the worker's end; what it posted is no longer carried out.
  void join();

  // Sessions, each until the device fails (why) or has nothing more (empty), with pauses between
  // them. `info`: of the device, as the session has it.
  void run(const DeviceInfo& info, Backoff& backoff, const std::function<std::string()>& session);
  void report(const DeviceInfo& info, DeviceState state);  // once until it changes
  // On the loop's thread, with the driver's sink.
  void post(std::function<void(SampleSink&)> action);
  bool stopping() const { return stopping_; }
  // False: it is time to end.
  bool pause(std::chrono::nanoseconds time);

 private:
  Loop& loop_;
  SampleSink* sink_ = nullptr;  // the loop's thread only
  bool finished_ = false;       // the loop's thread only
  std::thread thread_;
  DeviceState state_ = DeviceState::connecting;  // worker's thread only
  std::mutex mutex_;
  std::condition_variable wake_;
  std::atomic<bool> stopping_{false};
};

}  // namespace echofuse::port

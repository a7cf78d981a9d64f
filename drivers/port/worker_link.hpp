// SPDX-License-Identifier: MIT
// What the io thread and a driver's own thread share, without Asio in the header.
#pragma once
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>

#include "drivers/core/driver.hpp"

namespace echofuse::port {

// Threading: begin() and end() on the io thread; post(), pause() and stopping() on the worker's.
// The io context does not run out of work between begin() and end().
class WorkerLink : public std::enable_shared_from_this<WorkerLink> {
 public:
  explicit WorkerLink(boost::asio::io_context& io);
  ~WorkerLink();

  void begin(SampleSink& sink);
  // What is posted is no longer carried out; pauses end.
  void end();

  // On the io thread, with the driver's sink.
  void post(std::function<void(SampleSink&)> action);
  bool stopping() const { return stopping_; }
  // False: it is time to end.
  bool pause(std::chrono::nanoseconds time);

 private:
  struct Io;
  std::unique_ptr<Io> io_;
  SampleSink* sink_ = nullptr;  // io thread only
  std::mutex mutex_;
  std::condition_variable wake_;
  std::atomic<bool> stopping_{false};
};

}  // namespace echofuse::port

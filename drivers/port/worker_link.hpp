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

// Threading: begin(), stop(), finished() and leave() on the io thread; the others on the worker's.
// The io context does not run out of work between begin() and the worker's end.
class WorkerLink : public std::enable_shared_from_this<WorkerLink> {
 public:
  explicit WorkerLink(boost::asio::io_context& io);
  ~WorkerLink();

  void begin(SampleSink& sink);
  // Asks the worker to end: pauses end, what it posts is still carried out.
  void stop();
  // All that the worker posted was carried out.
  bool finished() const { return finished_; }
  // What is posted is no longer carried out.
  void leave();

  // The last that the worker does.
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
  bool finished_ = false;       // io thread only
  std::mutex mutex_;
  std::condition_variable wake_;
  std::atomic<bool> stopping_{false};
};

}  // namespace echofuse::port

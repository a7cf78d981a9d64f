// SPDX-License-Identifier: MIT
// Event loop: clock, timers and ports to the devices. Programs use one loop on Boost.Asio; tests
// use a loop with virtual time.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "drivers/core/clock.hpp"
#include "drivers/port/byte_port.hpp"

namespace echofuse::port {

using Action = std::function<void()>;

// Runs jobs in sequence, outside the loop.
class Worker {
 public:
  virtual ~Worker() = default;       // waits for queued jobs
  virtual void put(Action job) = 0;  // must not throw
};

// Threading: one thread runs the loop; post() may be called from any thread. An exception of an
// action leaves run_until(), which can be called again.
class Loop : public Clock {
 public:
  // Runs the action in the loop, never inside post().
  virtual void post(Action action) = 0;
  // Runs until `done` returns true, checked after each action, or until this time.
  void run_until(const std::function<bool()>& done, HostTime until = HostTime::max());
  void run_for(std::chrono::nanoseconds time);
  // With true, freezes now() for the calling thread.
  virtual void hold_time(bool /*hold*/) {}

  virtual std::unique_ptr<Worker> make_worker() = 0;
  // Throws Error(config) for an address without a byte stream, or an unsupported baud rate.
  virtual ByteOpener opener(const std::string& address, std::uint32_t baud = 115200) = 0;

 private:
  friend class Timer;
  using Alarms = std::multimap<HostTime, Action>;
  // Runs one posted action, or waits for one until this time; may return early.
  virtual void wait(HostTime until) = 0;
  // Runs one posted action; returns false if no action was posted.
  virtual bool poll() = 0;

  Alarms alarms_;
};

// Runs an action once. Threading: loop's thread only. The loop must outlive it. After cancel(), a
// new at() or destruction the old action does not run, even if it is already due.
class Timer {
 public:
  explicit Timer(Loop& loop) : loop_(loop) {}
  ~Timer() { cancel(); }
  Timer(const Timer&) = delete;
  Timer& operator=(const Timer&) = delete;

  void at(HostTime time, Action action);
  void after(std::chrono::nanoseconds delay, Action action) {
    at(loop_.now() + delay, std::move(action));
  }
  void cancel();

 private:
  Loop& loop_;
  std::optional<Loop::Alarms::iterator> alarm_;
};

// Loop on Boost.Asio and the system clocks; its workers are threads.
class SystemLoop final : public Loop {
 public:
  SystemLoop();
  ~SystemLoop() override;
  HostTime now() const override;
  UtcTime utc() const override;
  void hold_time(bool hold) override;
  void post(Action action) override;
  std::unique_ptr<Worker> make_worker() override;
  ByteOpener opener(const std::string& address, std::uint32_t baud) override;
  // Access for parts that need Asio itself.
  boost::asio::io_context& io();

 private:
  void wait(HostTime until) override;
  bool poll() override;

  struct Impl;
  std::unique_ptr<Impl> parts_;
};

}  // namespace echofuse::port

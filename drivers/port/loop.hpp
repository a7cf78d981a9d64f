// SPDX-License-Identifier: MIT
// Time, what is to be done when, and the ways to the devices. A program has one loop on Boost.Asio;
// tests have one whose time jumps.
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

// Runs jobs one after the other, beside the loop.
class Worker {
 public:
  virtual ~Worker() = default;       // returns once the jobs that it has are done
  virtual void put(Action job) = 0;  // must not throw
};

// Threading: one thread has the loop, but post() may be called from any thread. Exceptions of an
// action leave run_until(), which can be called again.
class Loop : public Clock {
 public:
  // The action runs in the loop, never inside post().
  virtual void post(Action action) = 0;
  // Runs until `done`, which is asked again after everything that ran, or until this time.
  void run_until(const std::function<bool()>& done, HostTime until = HostTime::max());
  void run_for(std::chrono::nanoseconds time);
  // true: now() stands still for the thread that holds it.
  virtual void hold_time(bool /*hold*/) {}

  virtual std::unique_ptr<Worker> make_worker() = 0;
  // Throws Error(config) for an address that carries no byte stream, or a baud rate that the
  // transport cannot do.
  virtual ByteOpener opener(const std::string& address, std::uint32_t baud = 115200) = 0;

 private:
  friend class Timer;
  using Alarms = std::multimap<HostTime, Action>;
  // Runs one action that is posted, or waits for one until this time; may return sooner.
  virtual void wait(HostTime until) = 0;
  // Runs one that is posted already; false if there is none.
  virtual bool poll() = 0;

  Alarms alarms_;
};

// Runs an action once. Threading: the loop's thread only. The loop outlives it. After cancel(), a
// new at() or destruction the old action does not run, even if its time has already come.
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

// Loop on Boost.Asio and the system's clocks; its workers are threads.
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

  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace echofuse::port

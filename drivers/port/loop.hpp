// SPDX-License-Identifier: MIT
// Event loop: clock, timers, and ports to the devices. Programs use one loop based on Boost.Asio.
// Tests use a loop with virtual time.
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

// Runs jobs one after another, outside the loop.
class Worker {
 public:
  virtual ~Worker() = default;       // waits until all queued jobs are done
  virtual void put(Action job) = 0;  // `job` must not throw
};

// Threading: one thread runs the loop; post() may be called by any thread. If an action throws,
// run_until() throws the exception and can be called again.
class Loop : public Clock {
 public:
  // Queues the action. The loop runs it later, never inside post().
  virtual void post(Action action) = 0;
  // Runs the loop until `done` returns true or the time `until` is reached. `done` is checked after
  // each action.
  void run_until(const std::function<bool()>& done, HostTime until = HostTime::max());
  void run_for(std::chrono::nanoseconds time);
  // If `hold` is true, now() returns the same time to the calling thread until hold_time(false) is
  // called.
  virtual void hold_time(bool /*hold*/) {}

  virtual std::unique_ptr<Worker> make_worker() = 0;
  // Throws Error(config) if the address does not refer to a byte stream, or if its port does not
  // support the baud rate.
  virtual ByteOpener opener(const std::string& address, std::uint32_t baud = 115200) = 0;

 private:
  friend class Timer;
  using Alarms = std::multimap<HostTime, Action>;
  // Runs one posted action. If none is queued, waits for one, at most until the time `until`. May
  // return early.
  virtual void wait(HostTime until) = 0;
  // Runs one posted action. Returns false if none is queued.
  virtual bool poll() = 0;

  Alarms alarms_;
};

// Runs an action once. The loop must outlive the timer. A scheduled action does not run after
// cancel(), another call of at(), or destruction, even if it is already due. Threading: use the
// timer only on the loop's thread.
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

// Loop that uses Boost.Asio, the system clocks, and threads as workers.
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
  // Returns the Asio context for code that uses Asio directly.
  boost::asio::io_context& io();

 private:
  void wait(HostTime until) override;
  bool poll() override;

  struct Impl;
  std::unique_ptr<Impl> parts_;
};

}  // namespace echofuse::port

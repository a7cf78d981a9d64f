// SPDX-License-Identifier: MIT
// Loop with virtual time: time is constant while actions are pending, then jumps to the next timer.
// Simulating a day or replaying a recording takes seconds, and the order of actions is
// deterministic.
#pragma once
#include <algorithm>
#include <deque>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

#include "drivers/port/loop.hpp"

namespace echofuse::port {

// Threading: use this class on one thread only.
class VirtualLoop final : public Loop {
 public:
  // Time starts at 1 s, because sample times must not be 0.
  explicit VirtualLoop(UtcTime utc = {}, HostTime now = std::chrono::seconds(1))
      : now_(now), utc_offset_(utc) {}

  HostTime now() const override { return now_; }
  UtcTime utc() const override { return utc_offset_ + now_; }
  // Changes the UTC time abruptly, as an administrator or NTP may do.
  void step_utc(std::chrono::nanoseconds by) { utc_offset_ += by; }

  void post(Action action) override { posted_.push_back(std::move(action)); }
  std::unique_ptr<Worker> make_worker() override { return std::make_unique<Queue>(*this); }
  ByteOpener opener(const std::string& address, std::uint32_t) override {
    return [this, address]() -> std::unique_ptr<BytePort> {
      const auto port = ports.find(address);
      if (port == ports.end()) return std::make_unique<NoPort>(*this, address);
      return port->second();
    };
  }

  std::map<std::string, ByteOpener> ports;  // openers of the attached ports, by address

 private:
  struct NoPort final : BytePort {
    NoPort(VirtualLoop& l, std::string a) : loop(l), address(std::move(a)) {}
    void open(PortHandlers handlers) override {
      loop.post([alive = std::weak_ptr(alive), text = address, gone = std::move(handlers.gone)] {
        if (!alive.expired()) gone({std::make_error_code(std::errc::no_such_device), text});
      });
    }
    void write(ByteView) override {}
    VirtualLoop& loop;
    std::string address;
    std::shared_ptr<int> alive = std::make_shared<int>();
  };
  // Worker that runs its jobs in the loop, one at a time.
  class Queue final : public Worker {
   public:
    explicit Queue(VirtualLoop& loop) : loop_(loop) {}
    ~Queue() override {
      while (!jobs_->empty()) step(*jobs_);
    }
    void put(Action job) override {
      jobs_->push_back(std::move(job));
      loop_.post([jobs = jobs_] {
        if (!jobs->empty()) step(*jobs);
      });
    }

   private:
    static void step(std::deque<Action>& jobs) {
      const Action job = std::move(jobs.front());
      jobs.pop_front();
      job();
    }
    VirtualLoop& loop_;
    std::shared_ptr<std::deque<Action>> jobs_ = std::make_shared<std::deque<Action>>();
  };

  void wait(HostTime until) override {
    if (poll()) return;
    if (until == HostTime::max()) throw std::logic_error("no timer and no action is pending");
    now_ = std::max(now_, until);
  }
  bool poll() override {
    if (posted_.empty()) return false;
    const Action action = std::move(posted_.front());
    posted_.pop_front();
    action();
    return true;
  }

  HostTime now_;
  std::chrono::nanoseconds utc_offset_;
  std::deque<Action> posted_;
};

}  // namespace echofuse::port

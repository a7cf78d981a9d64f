// SPDX-License-Identifier: MIT
#include "drivers/port/loop.hpp"

#include <algorithm>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "drivers/port/open_port.hpp"

namespace echofuse::port {

// Runs posted actions before due timers, because a timer may depend on the effect of an action.
// After 32 consecutive actions, a due timer runs, so that a flood of actions does not delay timers.
void Loop::run_until(const std::function<bool()>& done, HostTime until) {
  constexpr int max_before_a_timer = 32;
  for (int before = 0; !done();) {
    const HostTime time = now();
    if (time >= until) return;
    const bool due = !alarms_.empty() && alarms_.begin()->first <= time;
    if (!due) {
      wait(alarms_.empty() ? until : std::min(until, alarms_.begin()->first));
    } else if (before == max_before_a_timer || !poll()) {
      before = 0;
      const auto alarm = alarms_.extract(alarms_.begin());
      alarm.mapped()();
    } else {
      ++before;
    }
  }
}

void Loop::run_for(std::chrono::nanoseconds time) {
  run_until([] { return false; }, now() + time);
}

void Timer::at(HostTime time, Action action) {
  cancel();
  alarm_ = loop_.alarms_.emplace(time, [this, action = std::move(action)] {
    alarm_.reset();
    action();  // may destroy this timer
  });
}

void Timer::cancel() {
  if (alarm_) loop_.alarms_.erase(*alarm_);
  alarm_.reset();
}

namespace {

class Thread final : public Worker {
 public:
  Thread() : thread_([this] { work(); }) {}
  ~Thread() override {
    {
      const std::lock_guard lock(mutex_);
      ending_ = true;
    }
    wake_.notify_one();
    thread_.join();
  }
  void put(Action job) override {
    const std::lock_guard lock(mutex_);
    jobs_.push_back(std::move(job));
    wake_.notify_one();
  }

 private:
  void work() {
    std::unique_lock lock(mutex_);
    while (true) {
      wake_.wait(lock, [this] { return ending_ || !jobs_.empty(); });
      if (jobs_.empty()) return;
      Action job = std::move(jobs_.front());
      jobs_.pop_front();
      lock.unlock();
      job();
      job = nullptr;  // frees the job's captures before the next wait
      lock.lock();
    }
  }

  std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<Action> jobs_;
  bool ending_ = false;
  std::thread thread_;
};

}  // namespace

struct SystemLoop::Impl {
  boost::asio::io_context io;
  boost::asio::executor_work_guard<boost::asio::io_context::executor_type> work{
      io.get_executor()};  // makes run_one() wait even if no operation is pending
  boost::asio::steady_timer timer{io};
  std::optional<HostTime> armed;  // expiry time of `timer`, if it is running
};

SystemLoop::SystemLoop() : parts_(std::make_unique<Impl>()) {}
SystemLoop::~SystemLoop() = default;

namespace {
thread_local std::optional<HostTime> held_time;
}
HostTime SystemLoop::now() const { return held_time ? *held_time : system_clock.now(); }
void SystemLoop::hold_time(bool hold) {
  held_time = hold ? std::optional(system_clock.now()) : std::nullopt;
}
UtcTime SystemLoop::utc() const { return system_clock.utc(); }
void SystemLoop::post(Action action) { boost::asio::post(parts_->io, std::move(action)); }
std::unique_ptr<Worker> SystemLoop::make_worker() { return std::make_unique<Thread>(); }
ByteOpener SystemLoop::opener(const std::string& address, std::uint32_t baud) {
  return byte_opener(parts_->io, address, baud);
}
boost::asio::io_context& SystemLoop::io() { return parts_->io; }

bool SystemLoop::poll() { return parts_->io.poll_one() > 0; }

void SystemLoop::wait(HostTime until) {
  // Waits at most 20 ms, because signals only set a flag that `done` polls.
  constexpr std::chrono::milliseconds longest{20};
  const HostTime end = std::min(until, now() + longest);
  // Uses its own timer instead of run_one_until(), which waits in whole milliseconds.
  if (Impl& p = *parts_; !p.armed || end < *p.armed) {
    p.armed = end;
    p.timer.expires_at(std::chrono::steady_clock::time_point(end));
    p.timer.async_wait([&p](const boost::system::error_code& error) {
      if (!error) p.armed.reset();
    });
  }
  parts_->io.run_one();
}

}  // namespace echofuse::port

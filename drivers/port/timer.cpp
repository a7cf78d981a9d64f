// SPDX-License-Identifier: MIT
#include "drivers/port/timer.hpp"

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>

namespace echofuse::port {

struct Timer::State {
  explicit State(boost::asio::io_context& io) : timer(io) {}
  boost::asio::steady_timer timer;
  unsigned long armed = 0;  // a pending wait with another number is stale
};

Timer::Timer(boost::asio::io_context& io) : state_(std::make_shared<State>(io)) {}
Timer::~Timer() { cancel(); }

void Timer::after(std::chrono::nanoseconds delay, std::function<void()> action) {
  state_->timer.expires_after(delay);
  state_->timer.async_wait([state = state_, number = ++state_->armed,
                            action = std::move(action)](const boost::system::error_code& error) {
    if (!error && number == state->armed) action();
  });
}

void Timer::cancel() {
  ++state_->armed;
  state_->timer.cancel();
}

}  // namespace echofuse::port

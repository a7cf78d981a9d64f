// SPDX-License-Identifier: MIT
#pragma once
#include <chrono>
#include <functional>
#include <memory>

namespace boost::asio {
class io_context;
}

namespace echofuse::port {

// One shot on the io thread, without Asio in the header.
// Threading: io thread only. After cancel(), a new after() or destruction the old action does not
// run, not even if its time had already come.
class Timer {
 public:
  explicit Timer(boost::asio::io_context& io);
  ~Timer();
  Timer(const Timer&) = delete;
  Timer& operator=(const Timer&) = delete;

  void after(std::chrono::nanoseconds delay, std::function<void()> action);
  void cancel();

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace echofuse::port

// SPDX-License-Identifier: MIT
#pragma once
#include <algorithm>
#include <chrono>
#include <optional>
#include <string>
#include <utility>

namespace echofuse::port {

// Retry policy of all drivers: determines the pause before the next attempt, and whether to report
// a failure. The pause doubles from 100 ms up to 2 s. It is reset only after 5 s without a failure,
// so a device that responds once and fails again is retried at increasing intervals.
class Backoff {
 public:
  using Time = std::chrono::nanoseconds;

  explicit Backoff(std::chrono::milliseconds first = std::chrono::milliseconds(100),
                   std::chrono::milliseconds longest = std::chrono::seconds(2))
      : first_(first), longest_(longest), next_(first) {}

  // Returns true if this failure differs from the previous one and should therefore be reported.
  bool is_news(const std::string& why) { return std::exchange(reason_, why) != why; }
  // Returns the pause before the next attempt, and doubles the pause for the attempt after that.
  std::chrono::milliseconds next() {
    healthy_since_.reset();
    return std::exchange(next_, std::min(2 * next_, longest_));
  }
  // Records that the device delivered data at the monotonic time `now`.
  void alive(Time now) {
    reason_.clear();
    if (!healthy_since_) healthy_since_ = now;
    if (now - *healthy_since_ >= std::chrono::seconds(5)) next_ = first_;
  }

 private:
  std::chrono::milliseconds first_, longest_, next_;
  std::optional<Time> healthy_since_;
  std::string reason_;  // last failure; cleared when the device delivers data
};

}  // namespace echofuse::port

// SPDX-License-Identifier: MIT
#pragma once
#include <algorithm>
#include <chrono>
#include <optional>
#include <string>
#include <utility>

namespace echofuse::port {

// Reconnecting of every driver: how long to wait before the next attempt, and what to report.
// Pauses of 100 ms, doubled up to 2 s. Starts anew only after 5 s of health: a device that answers
// once and dies is retried ever more rarely.
class Backoff {
 public:
  using Time = std::chrono::nanoseconds;

  explicit Backoff(std::chrono::milliseconds first = std::chrono::milliseconds(100),
                   std::chrono::milliseconds longest = std::chrono::seconds(2))
      : first_(first), longest_(longest), next_(first) {}

  // The device failed for this reason: whether it is to be reported. Once, not at every attempt.
  bool is_news(const std::string& why) { return std::exchange(reason_, why) != why; }
  // The pause after it.
  std::chrono::milliseconds next() {
    healthy_since_.reset();
    return std::exchange(next_, std::min(2 * next_, longest_));
  }
  // The device did its work at this time (of a monotonic clock).
  void alive(Time now) {
    reason_.clear();
    if (!healthy_since_) healthy_since_ = now;
    if (now - *healthy_since_ >= std::chrono::seconds(5)) next_ = first_;
  }

 private:
  std::chrono::milliseconds first_, longest_, next_;
  std::optional<Time> healthy_since_;
  std::string reason_;  // last failure since the device did its work
};

}  // namespace echofuse::port

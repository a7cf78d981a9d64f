// SPDX-License-Identifier: MIT
#pragma once
#include <algorithm>
#include <chrono>

namespace echofuse::port {

// How long to wait before the next attempt: 100 ms, doubled up to 2 s.
class Backoff {
 public:
  std::chrono::milliseconds next() {
    const auto now = next_;
    next_ = std::min(2 * next_, std::chrono::milliseconds(2000));
    return now;
  }
  void reset() { *this = {}; }

 private:
  std::chrono::milliseconds next_{100};
};

}  // namespace echofuse::port

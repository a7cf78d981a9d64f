// SPDX-License-Identifier: MIT
#include "sim/devices/uart.hpp"

#include <algorithm>

namespace echofuse::sim {

void Uart::send(ByteView bytes, OnSent sent) {
  const std::uint64_t first = sent_ + lost_ + queue_.size();
  queue_.insert(queue_.end(), bytes.begin(), bytes.end());
  if (sent) waiting_.push_back({first, first + bytes.size(), std::move(sent)});
  begin();
}

void Uart::hold(bool still) {
  still_ = still;
  begin();
}

void Uart::begin() {
  if (pacing_ || still_ || queue_.empty()) return;
  pacing_ = true;
  due_ = loop_.now();
  pace();
}

void Uart::pace() {
  if (queue_.empty() || still_) {
    pacing_ = false;
    return;
  }
  // A byte takes ten bit times (8N1). Deadlines are absolute, so that late timers do not reduce the
  // throughput.
  const double bytes_per_s = baud_ / 10.0;
  const auto fits = static_cast<std::size_t>(
      std::max(1.0, bytes_per_s * std::chrono::duration<double>(chunk_time_).count()));
  const std::size_t n = std::min(fits, queue_.size());
  due_ += from_seconds(static_cast<double>(n) / bytes_per_s);
  timer_.at(due_, [this, n] {
    const auto end = queue_.begin() + static_cast<std::ptrdiff_t>(n);
    Bytes chunk(queue_.begin(), end);
    queue_.erase(queue_.begin(), end);
    const std::size_t arrived = deliver(std::move(chunk));
    sent_ += arrived;
    const std::uint64_t lost_from = sent_ + lost_;
    lost_ += n - arrived;
    if (arrived < n)
      for (Waiting& w : waiting_)
        w.whole = w.whole && (w.end <= lost_from || w.begin >= sent_ + lost_);
    while (!waiting_.empty() && waiting_.front().end <= sent_ + lost_) {
      const Waiting done = std::move(waiting_.front());
      waiting_.pop_front();
      done.sent(done.whole);
    }
    pace();
  });
}

}  // namespace echofuse::sim

// SPDX-License-Identifier: MIT
// Buffer of a stream parser: bytes of an unfinished frame wait for the rest; a frame that lies
// whole in one piece of input is never copied.
#pragma once
#include <algorithm>

#include "drivers/core/bytes.hpp"

namespace echofuse {

// Result of a parser's look at the buffered bytes.
struct Step {
  std::size_t used = 0;    // done with; 0 means that it needs more
  std::size_t wanted = 0;  // bytes in all before the next call can succeed (0: any more)
};

class FrameBuffer {
 public:
  // Keeps the memory of frames up to so many bytes, until clear() or give_back().
  explicit FrameBuffer(std::size_t most_kept = 1 << 20) : most_kept_(most_kept) {}
  // Shows consume(view) the unused bytes, in order and contiguous, until it wants more than there
  // are. consume must return {0, wanted} at the latest when its view is empty.
  template <class Consume>
  void feed(ByteView bytes, const Consume& consume) {
    while (!held().empty() && !bytes.empty()) {
      const std::size_t has = held().size();
      const std::size_t missing = wanted_ > has ? wanted_ - has : bytes.size();
      const ByteView head = bytes.first(std::min(missing, bytes.size()));
      held_.insert(held_.end(), head.begin(), head.end());
      bytes = bytes.subspan(head.size());
      if (held().size() < wanted_) return;
      again(consume);
    }
    if (held().empty() && !bytes.empty()) {
      const ByteView rest = bytes.subspan(run(bytes, consume));
      held_.assign(rest.begin(), rest.end());
    }
  }
  ByteView held() const { return ByteView(held_).subspan(used_); }
  void clear() {
    Bytes().swap(held_);
    used_ = wanted_ = 0;
  }
  std::size_t kept_bytes() const { return held_.capacity(); }
  // Between two frames.
  void give_back() {
    if (held_.empty()) clear();
  }

 private:
  // Shows it what is held once more.
  template <class Consume>
  void again(const Consume& consume) {
    used_ += run(held(), consume);
    // Drops used bytes when they are a quarter of the buffer, because each small frame would
    // otherwise move all bytes behind it.
    if (used_ == held_.size()) {
      held_.clear();
      if (held_.capacity() > most_kept_) held_.shrink_to_fit();
    } else if (used_ >= held_.size() / 4) {
      held_.erase(held_.begin(), held_.begin() + static_cast<std::ptrdiff_t>(used_));
    } else {
      return;
    }
    used_ = 0;
  }
  template <class Consume>
  std::size_t run(ByteView bytes, const Consume& consume) {
    std::size_t used = 0;
    for (;;) {
      const Step step = consume(bytes.subspan(used));
      if (step.used == 0) {
        wanted_ = step.wanted;
        return used;
      }
      used += step.used;
    }
  }

  std::size_t most_kept_;
  Bytes held_;
  std::size_t used_ = 0;  // bytes of held_ that are done with, from its beginning
  std::size_t wanted_ = 0;
};

}  // namespace echofuse

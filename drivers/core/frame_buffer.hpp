// SPDX-License-Identifier: MIT
// Buffer of a stream parser. Keeps the bytes of an incomplete frame. A frame that is complete in
// one input is parsed without a copy.
#pragma once
#include <algorithm>

#include "drivers/core/bytes.hpp"

namespace echofuse {

// Result of one call of the parser.
struct Step {
  std::size_t used = 0;    // bytes consumed; 0 if more bytes are needed
  std::size_t needed = 0;  // bytes needed for the next call to succeed; 0 if unknown
};

class FrameBuffer {
 public:
  // An empty buffer keeps up to `max_kept` bytes of memory allocated until clear() or give_back()
  // is called.
  explicit FrameBuffer(std::size_t max_kept = 1 << 20) : max_kept_(max_kept) {}
  // Repeatedly calls consume(view), where `view` contains unconsumed bytes in order and without
  // gaps, until `consume` needs more bytes than are available. For an empty view, `consume` must
  // return {0, needed}.
  template <class Consume>
  void feed(ByteView bytes, const Consume& consume) {
    while (!held().empty() && !bytes.empty()) {
      const std::size_t has = held().size();
      const std::size_t missing = needed_ > has ? needed_ - has : bytes.size();
      const ByteView head = bytes.first(std::min(missing, bytes.size()));
      held_.insert(held_.end(), head.begin(), head.end());
      bytes = bytes.subspan(head.size());
      if (held().size() < needed_) return;
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
    used_ = needed_ = 0;
  }
  std::size_t kept_bytes() const { return held_.capacity(); }
  // Frees the buffer's memory unless it contains an incomplete frame.
  void give_back() {
    if (held_.empty()) clear();
  }

 private:
  // Passes the buffered bytes to `consume`. Called after new bytes have been appended.
  template <class Consume>
  void again(const Consume& consume) {
    used_ += run(held(), consume);
    // Removes consumed bytes only once they fill a quarter of the buffer. Otherwise, all remaining
    // bytes would be moved after every small frame.
    if (used_ == held_.size()) {
      held_.clear();
      if (held_.capacity() > max_kept_) held_.shrink_to_fit();
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
        needed_ = step.needed;
        return used;
      }
      used += step.used;
    }
  }

  std::size_t max_kept_;
  Bytes held_;
  std::size_t used_ = 0;  // number of consumed bytes at the start of held_
  std::size_t needed_ = 0;
};

}  // namespace echofuse

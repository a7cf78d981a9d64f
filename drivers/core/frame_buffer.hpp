// SPDX-License-Identifier: MIT
// What every stream parser needs: the bytes of an unfinished frame wait for the rest, and a frame
// that lies whole in one piece of input is never copied.
#pragma once
#include <algorithm>

#include "drivers/core/bytes.hpp"

namespace echofuse {

// What a parser made of the bytes it was shown.
struct Step {
  std::size_t used = 0;  // done with; 0 means that it needs more
  std::size_t wanted =
      0;  // it needs this many in all before it is worth asking again (0: any more)
};

class FrameBuffer {
 public:
  // Shows consume(view) the unused bytes, in order and contiguous, until it wants more than there
  // are. consume must return {0, wanted} at the latest when its view is empty.
  template <class Consume>
  void feed(ByteView bytes, const Consume& consume) {
    while (!held_.empty() && !bytes.empty()) {
      const std::size_t missing = wanted_ > held_.size() ? wanted_ - held_.size() : bytes.size();
      const ByteView head = bytes.first(std::min(missing, bytes.size()));
      held_.insert(held_.end(), head.begin(), head.end());
      bytes = bytes.subspan(head.size());
      if (held_.size() < wanted_) return;
      const std::size_t used = run(held_, consume);
      held_.erase(held_.begin(), held_.begin() + static_cast<std::ptrdiff_t>(used));
    }
    if (held_.empty() && !bytes.empty()) {
      const ByteView rest = bytes.subspan(run(bytes, consume));
      held_.assign(rest.begin(), rest.end());
    }
  }
  ByteView held() const { return held_; }
  void clear() {
    held_.clear();
    wanted_ = 0;
  }

 private:
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

  Bytes held_;
  std::size_t wanted_ = 0;
};

}  // namespace echofuse

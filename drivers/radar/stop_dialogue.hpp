// SPDX-License-Identifier: MIT
// The last words to a radar: `sensorStop`, so that it does not radiate when nobody listens.
#pragma once
#include <string>

#include "drivers/core/bytes.hpp"

namespace echofuse::radar {

// As CommandDialogue without ports, and without clocks: who uses it gives up in time.
class StopDialogue {
 public:
  // `busy`: the firmware carries out a command. It has no room for another one until its prompt.
  explicit StopDialogue(bool busy) : sent_(!busy) {
    if (sent_) output_ = line;
  }
  void receive(ByteView bytes);
  std::string take_output();
  // The firmware answered that it has stopped.
  bool done() const { return done_; }

 private:
  static constexpr const char* line = "sensorStop\n";
  std::string answer_, output_;
  bool sent_, done_ = false;
};

}  // namespace echofuse::radar

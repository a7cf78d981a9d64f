// SPDX-License-Identifier: MIT
// Output that never blocks its writer, even if the terminal is stopped (Ctrl-S) or a pipe is not
// read.
#pragma once
#include <cstddef>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <thread>

namespace echofuse {

// Writes texts to one file descriptor in order, on its own thread. Keeps the newest 1 MiB of
// unwritten text; `note` makes the text that replaces N dropped ones.
// Threading: put() and the stream from any thread.
class OutputQueue {
 public:
  static constexpr std::size_t most_bytes = 1 << 20;
  using Note = std::function<std::string(std::size_t)>;
  OutputQueue(int descriptor, Note note);
  ~OutputQueue();
  OutputQueue(const OutputQueue&) = delete;
  OutputQueue& operator=(const OutputQueue&) = delete;

  // Returns false if older texts were dropped. A `state` replaces the previous state if that is not
  // yet written.
  bool put(std::string text, bool state = false);
  // Stream that puts its text when flushed. Closed with the queue.
  std::FILE* stream() const { return stream_; }
  // Waits until all text is written, or until nothing was written for 1 s; later texts are dropped.
  // Returns the errno of the last failed write, or 0.
  int close();

 private:
  struct Shared;
  std::shared_ptr<Shared> shared_;  // outlives this object while a write blocks
  std::FILE* stream_;
  std::thread thread_;
};

}  // namespace echofuse

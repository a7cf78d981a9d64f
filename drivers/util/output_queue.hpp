// SPDX-License-Identifier: MIT
// Output queue that never blocks the calling thread, even if the terminal is stopped (Ctrl-S) or
// the reader of a pipe does not read.
#pragma once
#include <cstddef>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <thread>

namespace echofuse {

// Writes texts to a file descriptor in order, on its own thread. At most 1 MiB of unwritten text is
// kept; older texts are dropped. `note` returns the text that replaces N dropped texts. Threading:
// any thread may call put() and use the stream.
class OutputQueue {
 public:
  static constexpr std::size_t most_bytes = 1 << 20;
  using Note = std::function<std::string(std::size_t)>;
  OutputQueue(int descriptor, Note note);
  ~OutputQueue();
  OutputQueue(const OutputQueue&) = delete;
  OutputQueue& operator=(const OutputQueue&) = delete;

  // Returns false if texts were dropped. If `state` is true, the text replaces an unwritten earlier
  // text that was also put with `state`.
  bool put(std::string text, bool state = false);
  // Returns a stream that puts its text into the queue when it is flushed. The stream is closed
  // together with the queue.
  std::FILE* stream() const { return stream_; }
  // Waits until all text is written, or until no text was written for 1 s. Text that is not yet
  // written is then dropped. Returns the errno of the last failed write, or 0.
  int close();

 private:
  struct Shared;
  std::shared_ptr<Shared> shared_;  // outlives this object if a write blocks the thread
  std::FILE* stream_;
  std::thread thread_;
};

}  // namespace echofuse

// SPDX-License-Identifier: MIT
// Output queue that never blocks the calling thread, even if the terminal is stopped (Ctrl-S) or
// the reader of a pipe does not read.
#pragma once
#include <cstddef>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <thread>

namespace echofuse {

// Writes the whole text. Waits if the descriptor is non-blocking. Returns 0, or errno on failure.
int write_all(int descriptor, std::string_view text);

// Writes messages to a file descriptor in order, on its own thread. Keeps at most 1 MiB of
// unwritten messages; if there are more, drops the oldest. `note` returns the message that replaces
// N dropped messages. Threading: any thread may call put() and use the stream.
class OutputQueue {
 public:
  static constexpr std::size_t max_bytes = 1 << 20;
  using Note = std::function<std::string(std::size_t)>;
  OutputQueue(int descriptor, Note note);
  ~OutputQueue();
  OutputQueue(const OutputQueue&) = delete;
  OutputQueue& operator=(const OutputQueue&) = delete;

  // Queues a message. Returns false if messages were dropped. If `state` is true, the message
  // replaces an earlier unwritten message that was also queued with `state`.
  bool put(std::string text, bool state = false);
  // Returns a stream; flushing it queues the buffered text as a message. The stream is closed
  // together with the queue.
  std::FILE* stream() const { return stream_; }
  // Waits until all messages have been written, or until nothing has been written for 1 s. Drops
  // messages that have not been written by then. Returns the errno of the last failed write, or 0.
  int close();

 private:
  struct Shared;
  std::shared_ptr<Shared> shared_;  // outlives this object if a write blocks the thread
  std::FILE* stream_;
  std::thread thread_;
};

}  // namespace echofuse

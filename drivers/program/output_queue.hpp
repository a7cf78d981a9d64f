// SPDX-License-Identifier: MIT
// Output that never keeps its writer waiting: a terminal may be held (Ctrl-S), a pipe unread.
#pragma once
#include <cstddef>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <thread>

namespace echofuse {

// Texts for one file descriptor, in order, written by a thread of its own. The newest 1 MiB of what
// is not taken is kept; `note` makes the text in place of so many that were left out.
// Threading: put() and the stream from any thread.
class OutputQueue {
 public:
  static constexpr std::size_t most_bytes = 1 << 20;
  using Note = std::function<std::string(std::size_t)>;
  OutputQueue(int descriptor, Note note);
  ~OutputQueue();
  OutputQueue(const OutputQueue&) = delete;
  OutputQueue& operator=(const OutputQueue&) = delete;

  // False if older texts are left out for this one. A `state` replaces the one before if that still
  // waits.
  bool put(std::string text, bool state = false);
  // Stream whose flushed text is put. Closed with the queue.
  std::FILE* stream() const { return stream_; }
  // Waits until all is written, or nothing was taken for a second; nothing is put after it. Returns
  // the errno of the last text that could not be written, or 0.
  int close();

 private:
  struct Shared;
  std::shared_ptr<Shared> shared_;  // outlives this while a write stands still
  std::FILE* stream_;
  std::thread thread_;
};

}  // namespace echofuse

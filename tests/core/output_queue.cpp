// SPDX-License-Identifier: MIT
// Tests that a blocked or closed output never blocks its writer.
#include "drivers/util/output_queue.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <utility>

#include "../catch.hpp"

namespace {

struct Pipe {
  Pipe() {
    std::signal(SIGPIPE, SIG_IGN);  // a queue may still be writing when the pipe is closed
    REQUIRE(::pipe2(ends, O_CLOEXEC) == 0);
  }
  ~Pipe() {
    for (const int end : ends) ::close(end);
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  std::string read() const {
    std::string text(1 << 21, '\0');
    const ssize_t n = ::read(ends[0], text.data(), text.size());
    text.resize(n > 0 ? static_cast<std::size_t>(n) : 0);
    return text;
  }
  int ends[2] = {-1, -1};
};

std::string left_out(std::size_t count) { return "<" + std::to_string(count) + ">"; }

}  // namespace

TEST_CASE("the output queue writes all messages in order before it closes") {
  const Pipe pipe;
  OutputQueue queue(pipe.ends[1], left_out);
  for (int i = 0; i < 1000; ++i) CHECK(queue.put(std::to_string(i) + ' '));
  CHECK(queue.close() == 0);
  const std::string text = pipe.read();
  CHECK(text.starts_with("0 1 2 "));
  CHECK(text.ends_with(" 998 999 "));
}

TEST_CASE("closing the output queue waits as long as the reader continues to read") {
  // The messages fill the 64 KiB buffer of the pipe eight times, or exceed the limit of the queue.
  const auto [count, size] =
      GENERATE(table<std::size_t, std::size_t>({{8, 1 << 16}, {1, OutputQueue::max_bytes + 1}}));
  const Pipe pipe;
  OutputQueue queue(pipe.ends[1], left_out);
  for (std::size_t i = 0; i < count; ++i)
    CHECK(queue.put(std::string(size, '.')) == (size <= OutputQueue::max_bytes));
  std::string text;
  std::thread reader([&, bytes = count * size] {
    while (text.size() < bytes) text += pipe.read(), std::this_thread::yield();
  });
  CHECK(queue.close() == 0);
  reader.join();
  CHECK((text == std::string(count * size, '.')));
}

TEST_CASE("the output queue keeps the newest messages if the reader stops reading") {
  const Pipe pipe;
  OutputQueue queue(pipe.ends[1], left_out);
  // A string of 256 KiB does not fit into the pipe's 64 KiB buffer, even after the reader has read
  // once.
  const std::string filling(1 << 18, '.');
  queue.put(filling);
  while (pipe.read().empty()) std::this_thread::yield();  // waits until the write has begun
  const std::string half(OutputQueue::max_bytes / 2, 'a');
  CHECK(queue.put("first"));
  CHECK(queue.put(half));
  CHECK_FALSE(queue.put(half));
  for (const char* state : {"state 1", "state 2", "state 3"}) queue.put(state, true);
  std::string text;
  std::thread reader([&] {
    while (!text.ends_with("state 3")) text += pipe.read();
  });
  reader.join();
  CHECK(text.find("first") == std::string::npos);
  CHECK(text.find("state 1") == std::string::npos);
  // The four dropped messages are "first", one `half`, "state 1" and "state 2".
  CHECK(text.ends_with("<4>" + half + "state 3"));
  CHECK(queue.close() == 0);
}

TEST_CASE("closing the output queue waits one second for a reader that stopped reading") {
  Pipe pipe;
  OutputQueue queue(pipe.ends[1], left_out);
  queue.put(std::string(1 << 18, '.'));
  queue.put("last");
  const auto begin = std::chrono::steady_clock::now();
  CHECK(queue.close() == 0);
  const std::chrono::duration<double> waited_s = std::chrono::steady_clock::now() - begin;
  CHECK((waited_s.count() >= 1 && waited_s.count() < 20));
  // Prevents the pipe from closing this end, because the blocked write still uses it.
  std::exchange(pipe.ends[1], -1);
}

TEST_CASE("the output queue reports a closed reader and a full disk when it closes") {
  Pipe pipe;
  const bool full = GENERATE(false, true);
  if (full) ::dup2(::open("/dev/full", O_WRONLY | O_CLOEXEC), pipe.ends[1]);
  ::close(std::exchange(pipe.ends[0], -1));
  OutputQueue queue(pipe.ends[1], left_out);
  for (int i = 0; i < 100; ++i) CHECK(queue.put("line\n"));
  CHECK(queue.close() == (full ? ENOSPC : EPIPE));
}

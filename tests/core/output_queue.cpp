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
  Pipe() { REQUIRE(::pipe2(ends, O_CLOEXEC) == 0); }
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
  const Pipe pipe;
  OutputQueue queue(pipe.ends[1], left_out);
  // Each string fills the 64 KiB buffer of the pipe.
  for (int i = 0; i < 8; ++i) queue.put(std::string(1 << 16, '.'));
  std::size_t taken = 0;
  std::thread reader([&] {
    while (taken < 8 << 16) taken += pipe.read().size(), std::this_thread::yield();
  });
  CHECK(queue.close() == 0);
  reader.join();
  CHECK(taken == 8 << 16);
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

TEST_CASE("the output queue writes a message that is longer than its limit completely") {
  Pipe pipe;
  OutputQueue queue(pipe.ends[1], left_out);
  const std::string huge(OutputQueue::max_bytes + 1, 'a');
  CHECK_FALSE(queue.put(huge));
  std::string text;
  std::thread reader([&] {
    for (std::string part; !(part = pipe.read()).empty();) text += part;
  });
  CHECK(queue.close() == 0);
  ::close(std::exchange(pipe.ends[1], -1));
  reader.join();
  CHECK((text == huge));
}

TEST_CASE(
    "closing the output queue waits one second for a stopped reader, but not for a closed one") {
  std::signal(SIGPIPE, SIG_IGN);
  const auto begin = std::chrono::steady_clock::now();
  const auto waited = [&] { return std::chrono::steady_clock::now() - begin; };
  SECTION("closing the output queue waits one second for a reader that stopped reading") {
    Pipe pipe;
    OutputQueue queue(pipe.ends[1], left_out);
    queue.put(std::string(1 << 18, '.'));
    queue.put("last");
    CHECK(queue.close() == 0);
    CHECK(waited() >= std::chrono::seconds(1));
    CHECK(waited() < std::chrono::seconds(20));
    // Prevents the pipe from closing this end, because the blocked write still uses it.
    std::exchange(pipe.ends[1], -1);
  }
  SECTION("closing the output queue does not wait for a reader that closed its end") {
    Pipe pipe;
    ::close(std::exchange(pipe.ends[0], -1));
    OutputQueue queue(pipe.ends[1], left_out);
    for (int i = 0; i < 100; ++i) CHECK(queue.put("line\n"));
    CHECK(queue.close() == EPIPE);
  }
  SECTION("closing the output queue does not wait if the disk is full") {
    const int full = ::open("/dev/full", O_WRONLY | O_CLOEXEC);
    OutputQueue queue(full, left_out);
    queue.put("line\n");
    CHECK(queue.close() == ENOSPC);
    ::close(full);
  }
}

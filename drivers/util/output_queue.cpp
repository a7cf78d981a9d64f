// SPDX-License-Identifier: MIT
#include "drivers/util/output_queue.hpp"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <string_view>
#include <utility>

namespace echofuse {
namespace {

constexpr std::chrono::seconds max_pause{1};

}  // namespace

int write_all(int descriptor, std::string_view text) {
  while (!text.empty()) {
    const ssize_t n = ::write(descriptor, text.data(), text.size());
    pollfd ready{descriptor, POLLOUT, 0};
    if (n >= 0)
      text.remove_prefix(static_cast<std::size_t>(n));
    else if (errno == EAGAIN)  // another program has made the terminal non-blocking
      ::poll(&ready, 1, -1);
    else if (errno != EINTR)
      return errno;
  }
  return 0;
}

struct OutputQueue::Shared {
  struct QueuedText {
    std::string text;
    bool state;
  };

  std::string pop(std::deque<QueuedText>::iterator at) {
    std::string text = std::move(at->text);
    texts.erase(at);
    bytes -= text.size();
    return text;
  }

  void write() {
    std::unique_lock lock(mutex);
    while (true) {
      changed.wait(lock, [this] { return ending || !texts.empty(); });
      if (texts.empty()) break;
      std::string text = left_out > 0 ? note(std::exchange(left_out, 0)) : "";
      text += pop(texts.begin());
      lock.unlock();
      const int failure = write_all(descriptor, text);
      lock.lock();
      if (failure != 0) error = failure;
      ++written;
      changed.notify_all();
    }
    done = true;
    changed.notify_all();
  }

  const int descriptor;
  const Note note;
  std::mutex mutex{};
  std::condition_variable changed{};
  std::deque<QueuedText> texts{};
  std::size_t bytes = 0, left_out = 0, written = 0;
  bool ending = false, done = false;
  int error = 0;
};

OutputQueue::OutputQueue(int descriptor, Note note)
    : shared_(new Shared{descriptor, std::move(note)}),
      stream_(::fopencookie(this, "w",
                            {.read = nullptr,
                             .write =
                                 [](void* self, const char* text, std::size_t size) {
                                   static_cast<OutputQueue*>(self)->put({text, size});
                                   return static_cast<ssize_t>(size);
                                 },
                             .seek = nullptr,
                             .close = nullptr})),
      thread_([shared = shared_] { shared->write(); }) {}

OutputQueue::~OutputQueue() {
  std::fclose(stream_);
  if (thread_.joinable()) close();
}

bool OutputQueue::put(std::string text, bool state) {
  Shared& s = *shared_;
  const std::lock_guard lock(s.mutex);
  const auto leave_out = [&](auto at) { s.pop(at), ++s.left_out; };
  const auto before = std::find_if(s.texts.begin(), s.texts.end(), [](auto& t) { return t.state; });
  if (state && before != s.texts.end()) leave_out(before);
  s.bytes += text.size();
  s.texts.push_back({std::move(text), state});
  const bool room = s.bytes <= max_bytes;
  while (s.bytes > max_bytes && s.texts.size() > 1) leave_out(s.texts.begin());
  s.changed.notify_all();
  return room;
}

int OutputQueue::close() {
  Shared& s = *shared_;
  std::unique_lock lock(s.mutex);
  s.ending = true;
  s.changed.notify_all();
  // Waits at most one second for each message to be written.
  for (std::size_t before = s.written; !s.done; before = s.written)
    if (!s.changed.wait_for(lock, max_pause, [&] { return s.done || s.written != before; })) break;
  const auto [done, error] = std::pair(s.done, s.error);
  if (!done) s.texts.clear();
  lock.unlock();
  done ? thread_.join() : thread_.detach();
  return error;
}

}  // namespace echofuse

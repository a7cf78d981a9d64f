// SPDX-License-Identifier: MIT
#include "drivers/port/raw_tap.hpp"

#include <fcntl.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstring>
#include <deque>
#include <filesystem>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include "drivers/program/exit_code.hpp"

namespace echofuse::port {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::seconds finish_timeout{2};
constexpr std::size_t most_open = 16;  // files; a device has one at a time, the older ones are done
constexpr std::uint64_t look_at_room_every = 16u << 20;  // bytes

class Descriptor {
 public:
  explicit Descriptor(int fd = -1) : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  int get() const { return fd_; }

 private:
  int fd_;
};

}  // namespace

struct RawKeeper::Shared {
  Shared(std::string dir, RawLimits l) : folder(std::move(dir)), limits(l) {}

  struct Piece {
    std::string name;
    Bytes bytes;
  };
  const std::string folder;
  const RawLimits limits;

  std::mutex mutex;  // of all below
  std::condition_variable wake, done;
  std::deque<Piece> queue;
  std::size_t queued_bytes = 0;  // with those that are being written
  Counts counts;
  std::map<std::string, int> numbers;
  std::string trouble;
  bool closing = false, ended = false;  // ended: nothing more is written

  void run();
  std::string write(const Piece& piece);

  // Of the writer's thread only.
  std::deque<std::pair<std::string, Descriptor>> files;
  std::uint64_t unlooked = look_at_room_every;  // bytes since the last look at the room
};

void RawKeeper::Shared::run() {
  std::unique_lock lock(mutex);
  while (true) {
    wake.wait(lock, [this] { return closing || !queue.empty(); });
    if (queue.empty() || ended) break;
    Piece piece = std::move(queue.front());
    queue.pop_front();
    lock.unlock();
    const std::string wrong = write(piece);
    lock.lock();
    queued_bytes -= piece.bytes.size();
    (wrong.empty() ? counts.kept : counts.dropped) += piece.bytes.size();
    if (wrong.empty()) continue;
    trouble = wrong + "; raw bytes are no longer kept, the run goes on";
    break;
  }
  ended = true;
  for (const Piece& piece : queue) counts.dropped += piece.bytes.size();
  queue.clear();
  done.notify_all();
}

// Empty, or what is wrong.
std::string RawKeeper::Shared::write(const Piece& piece) {
  const std::string path = folder + "/" + piece.name;
  unlooked += piece.bytes.size();
  if (unlooked >= look_at_room_every) {
    unlooked = 0;
    struct statvfs room {};
    if (::statvfs(folder.c_str(), &room) == 0 &&
        std::uint64_t{room.f_bavail} * room.f_frsize < limits.reserve_bytes)
      return folder + ": less than " + std::to_string(limits.reserve_bytes >> 20) +
             " MiB are free, which are left to the run";
  }
  if (files.empty() || files.back().first != piece.name) {
    auto it = files.begin();
    while (it != files.end() && it->first != piece.name) ++it;
    if (it == files.end()) {
      Descriptor fd(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644));
      if (fd.get() < 0) return path + ": " + std::strerror(errno);
      if (files.size() == most_open) files.pop_front();
      files.emplace_back(piece.name, std::move(fd));
    } else if (it != files.end() - 1) {
      auto used = std::move(*it);
      files.erase(it);
      files.push_back(std::move(used));
    }
  }
  for (ByteView rest = piece.bytes; !rest.empty();) {
    const ssize_t n = ::write(files.back().second.get(), rest.data(), rest.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return path + ": " + std::strerror(errno);
    rest = rest.subspan(static_cast<std::size_t>(n));
  }
  return {};
}

RawKeeper::RawKeeper(std::string folder, RawLimits limits)
    : shared_(std::make_shared<Shared>(std::move(folder), limits)) {
  const std::string& dir = shared_->folder;
  std::error_code error;
  fs::create_directories(dir, error);
  if (!error && !fs::is_empty(dir, error) && !error)
    throw Error(ExitCode::usage, dir + ": is not empty; raw bytes want a folder of their own");
  if (error) throw Error(ExitCode::disk, dir + ": " + error.message());
  std::thread([shared = shared_] { shared->run(); }).detach();  // finish() waits for it, if it can
}

RawKeeper::~RawKeeper() { finish(); }

bool RawKeeper::put(const std::string& name, ByteView bytes) {
  if (bytes.empty()) return false;
  const std::lock_guard lock(shared_->mutex);
  Shared& s = *shared_;
  if (s.ended || s.closing || s.queued_bytes + bytes.size() > s.limits.queue_bytes) {
    s.counts.dropped += bytes.size();
    return false;
  }
  s.queued_bytes += bytes.size();
  s.queue.push_back({name, Bytes(bytes.begin(), bytes.end())});
  s.wake.notify_one();
  return true;
}

void RawKeeper::put_text(const std::string& name, const std::string& text) {
  put(name, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

void RawKeeper::note(const std::string& name, HostTime at, const char* what, std::int64_t value) {
  put_text(name + ".times",
           std::to_string(at.count()) + " " + what + " " + std::to_string(value) + "\n");
}

std::string RawKeeper::next_name(const std::string& name, const std::string& ending) {
  const std::lock_guard lock(shared_->mutex);
  char number[16];
  std::snprintf(number, sizeof number, "-%03d", ++shared_->numbers[name]);
  return name + number + ending;
}

std::string RawKeeper::take_trouble() {
  const std::lock_guard lock(shared_->mutex);
  return std::exchange(shared_->trouble, {});
}

RawKeeper::Counts RawKeeper::finish() {
  std::unique_lock lock(shared_->mutex);
  shared_->closing = true;
  shared_->wake.notify_one();
  // A disk that hangs holds its thread, not the run's end.
  shared_->done.wait_for(lock, finish_timeout, [this] { return shared_->ended; });
  shared_->ended = true;
  for (const auto& piece : shared_->queue) shared_->counts.dropped += piece.bytes.size();
  shared_->queue.clear();
  return shared_->counts;
}

namespace {

struct HeldTime {
  explicit HeldTime(Loop& l) : loop(l) { loop.hold_time(true); }
  ~HeldTime() { loop.hold_time(false); }
  HeldTime(const HeldTime&) = delete;
  HeldTime& operator=(const HeldTime&) = delete;
  Loop& loop;
};

class TapPort final : public BytePort {
 public:
  TapPort(Loop& loop, std::unique_ptr<BytePort> port, RawKeeper* keeper, std::string name,
          std::string ending)
      : loop_(loop),
        port_(std::move(port)),
        keeper_(keeper),
        name_(std::move(name)),
        ending_(std::move(ending)) {}
  void open(PortHandlers handlers) override {
    keeper_->note(name_, loop_.now(), "open");
    // The handlers outlive this port while one of them runs.
    handlers.opened = [&loop = loop_, keeper = keeper_, name = name_,
                       next = std::move(handlers.opened)] {
      const HeldTime held(loop);
      keeper->note(name, loop.now(), "opened");
      next();
    };
    handlers.bytes = [&loop = loop_, keeper = keeper_, name = name_, ending = ending_,
                      file = std::string(),
                      next = std::move(handlers.bytes)](ByteView bytes) mutable {
      const HeldTime held(loop);
      if (file.empty()) file = keeper->next_name(name, ending);
      if (keeper->put(file, bytes))
        keeper->note(name, loop.now(), "bytes", static_cast<std::int64_t>(bytes.size()));
      next(bytes);
    };
    handlers.gone = [&loop = loop_, keeper = keeper_, name = name_,
                     next = std::move(handlers.gone)](const Failure& failure) {
      const HeldTime held(loop);
      keeper->note(name, loop.now(), "gone", failure.code.value());
      next(failure);
    };
    port_->open(std::move(handlers));
  }
  void write(ByteView bytes) override { port_->write(bytes); }

 private:
  Loop& loop_;
  std::unique_ptr<BytePort> port_;
  RawKeeper* keeper_;
  std::string name_, ending_;
};

}  // namespace

ByteOpener tap(Loop& loop, ByteOpener opener, RawKeeper* keeper, std::string name,
               std::string ending) {
  if (!keeper) return opener;
  return [&loop, opener = std::move(opener), keeper, name = std::move(name),
          ending = std::move(ending)]() -> std::unique_ptr<BytePort> {
    return std::make_unique<TapPort>(loop, opener(), keeper, name, ending);
  };
}

}  // namespace echofuse::port

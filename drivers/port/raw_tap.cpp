// SPDX-License-Identifier: MIT
#include "drivers/port/raw_tap.hpp"

#include <fcntl.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <filesystem>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/output_queue.hpp"

namespace echofuse::port {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::seconds finish_timeout{2};
// number of bytes written between two checks of the free space
constexpr std::uint64_t look_at_room_every = 16u << 20;

}  // namespace

struct RawKeeper::Shared {
  Shared(std::string dir, RawLimits l) : folder(std::move(dir)), limits(l) {}
  void take(const std::string& name, ByteView bytes);
  std::string write(const std::string& path, ByteView bytes);

  const std::string folder;
  const RawLimits limits;
  std::uint64_t unlooked = look_at_room_every;  // bytes stored since the last check of free space

  std::mutex mutex;  // protects the members below
  std::condition_variable done;
  std::size_t queued_bytes = 0;  // number of bytes stored since the free space was last checked
  Counts counts;
  std::map<std::string, int> numbers;
  std::string trouble;
  bool closing = false, ended = false;  // `ended` is true once the capture has stopped
};

// Writes the bytes and updates the counts, on the worker's thread.
void RawKeeper::Shared::take(const std::string& name, ByteView bytes) {
  std::unique_lock lock(mutex);
  const bool keeps = !ended;
  lock.unlock();
  const std::string wrong = keeps ? write(folder + "/" + name, bytes) : "";
  lock.lock();
  queued_bytes -= bytes.size();
  (keeps && wrong.empty() ? counts.kept : counts.dropped) += bytes.size();
  if (!wrong.empty()) {
    trouble = wrong + "; raw capture stopped, the run continues";
    ended = true;
  }
  done.notify_all();
}

// Checks the free space and appends the bytes. Returns an error message, or an empty string on
// success.
std::string RawKeeper::Shared::write(const std::string& path, ByteView bytes) {
  unlooked += bytes.size();
  if (unlooked >= look_at_room_every) {
    unlooked = 0;
    struct statvfs room {};
    if (::statvfs(folder.c_str(), &room) == 0 &&
        std::uint64_t{room.f_bavail} * room.f_frsize < limits.reserve_bytes)
      return folder + ": less than " + std::to_string(limits.reserve_bytes >> 20) +
             " MiB free (reserved for the run)";
  }
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_NOFOLLOW | O_CLOEXEC, 0644);
  const int error =
      fd < 0 ? errno : write_all(fd, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  if (fd >= 0) ::close(fd);
  return error == 0 ? "" : path + ": " + std::strerror(error);
}

RawKeeper::RawKeeper(std::string folder, std::unique_ptr<Worker> worker, RawLimits limits)
    : shared_(std::make_shared<Shared>(std::move(folder), limits)), worker_(std::move(worker)) {
  const std::string& dir = shared_->folder;
  std::error_code error;
  fs::create_directories(dir, error);
  if (!error && !fs::is_empty(dir, error) && !error)
    throw Error(ExitCode::usage, dir + ": is not empty; raw capture needs an empty folder");
  if (error) throw Error(ExitCode::disk, dir + ": " + error.message());
}

// If a write to the disk blocks, the worker's thread is detached, so that the run can end.
RawKeeper::~RawKeeper() {
  finish();
  const std::lock_guard lock(shared_->mutex);
  if (shared_->queued_bytes > 0) std::thread([worker = std::move(worker_)] {}).detach();
}

bool RawKeeper::put(const std::string& name, ByteView bytes) {
  if (bytes.empty()) return false;
  const std::lock_guard lock(shared_->mutex);
  Shared& s = *shared_;
  if (s.ended || s.closing || s.queued_bytes + bytes.size() > s.limits.queue_bytes) {
    s.counts.dropped += bytes.size();
    return false;
  }
  s.queued_bytes += bytes.size();
  worker_->put([shared = shared_, name, held = Bytes(bytes.begin(), bytes.end())] {
    shared->take(name, held);
  });
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
  return name + format("-%03d", ++shared_->numbers[name]) + ending;
}

std::string RawKeeper::take_trouble() {
  const std::lock_guard lock(shared_->mutex);
  return std::exchange(shared_->trouble, {});
}

RawKeeper::Counts RawKeeper::finish() {
  Shared& s = *shared_;
  std::unique_lock lock(s.mutex);
  s.closing = true;
  s.done.wait_for(lock, finish_timeout, [&] { return s.queued_bytes == 0; });
  s.ended = true;
  return {s.counts.kept, s.counts.dropped + s.queued_bytes};
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
    // The handlers do not capture `this`, because a running handler may destroy the port.
    const auto note = [&loop = loop_, keeper = keeper_, name = name_](const char* what,
                                                                      std::int64_t value = 0) {
      keeper->note(name, loop.now(), what, value);
    };
    note("open");
    handlers.opened = [&loop = loop_, note, next = std::move(handlers.opened)] {
      const HeldTime held(loop);
      note("opened");
      next();
    };
    handlers.bytes = [&loop = loop_, note, keeper = keeper_, name = name_, ending = ending_,
                      file = std::string(),
                      next = std::move(handlers.bytes)](ByteView bytes) mutable {
      const HeldTime held(loop);
      if (file.empty()) file = keeper->next_name(name, ending);
      if (keeper->put(file, bytes)) note("bytes", static_cast<std::int64_t>(bytes.size()));
      next(bytes);
    };
    handlers.gone = [&loop = loop_, note, next = std::move(handlers.gone)](const Failure& failure) {
      const HeldTime held(loop);
      note("gone", failure.code.value());
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

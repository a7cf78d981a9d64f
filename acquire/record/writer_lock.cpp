// SPDX-License-Identifier: MIT
#include "acquire/record/writer_lock.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "acquire/record/file_lock.hpp"
#include "drivers/program/atomic_write.hpp"
#include "drivers/program/exit_code.hpp"

namespace echofuse::record {
namespace {

// An empty file, or the zeros that reserve() put into it: nothing that could be lost.
bool is_ours(int fd) {
  struct stat file {};
  if (::fstat(fd, &file) != 0 || !S_ISREG(file.st_mode) || file.st_nlink != 1) return false;
  if (file.st_size > 1 << 20) return false;
  std::array<char, 4096> part{};
  for (off_t at = 0; at < file.st_size;) {
    const ssize_t n = ::pread(fd, part.data(), part.size(), at);
    if (n <= 0) return false;
    if (std::any_of(part.begin(), part.begin() + n, [](char c) { return c != 0; })) return false;
    at += n;
  }
  return true;
}

[[noreturn]] void refuse(const std::string& path) {
  throw Error(ExitCode::failed,
              path + ": is not a lock file of echofuse (an empty file of that name); move it away");
}

}  // namespace

WriterLock::WriterLock(const std::string& run_path) {
  const std::string path = run_path + "-lock";
  fd_ = ::open(path.c_str(), O_CREAT | O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0644);
  if (fd_ < 0) {
    if (errno == ELOOP || errno == EISDIR || errno == ENXIO || errno == ENODEV) refuse(path);
    throw Error(ExitCode::disk, path + ": cannot make the lock file: " + std::strerror(errno));
  }
  if (!is_ours(fd_)) {
    ::close(fd_);
    refuse(path);
  }
  let_group_read(fd_);  // who may read the run sees whether it is live
  const int error = take_lock(fd_);
  held_ = error == 0;
  if (held_ || error == EAGAIN) return;
  ::close(fd_);
  throw Error(ExitCode::disk, path + ": this file system does not lock: " + std::strerror(error));
}

WriterLock::~WriterLock() {
  release();
  ::close(fd_);
}

void WriterLock::reserve(off_t bytes) const {
  if (held_ && posix_fallocate(fd_, 0, bytes) != 0) release();
}

void WriterLock::release() const {
  if (held_ && ftruncate(fd_, 0) != 0) return;  // then there is no room: what follows says so
}

bool WriterLock::someone_writes(const std::string& run_path) {
  const int fd =
      ::open((run_path + "-lock").c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (fd < 0) return false;
  const bool busy = somebody_has_lock(fd);
  ::close(fd);
  return busy;
}

}  // namespace echofuse::record

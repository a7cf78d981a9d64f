// SPDX-License-Identifier: MIT
// Who is writing a run: the writer holds flock(2) on PATH-lock for as long as it lives, so that a
// reader can tell a live run from one that a crash left behind. A separate file, because closing
// any descriptor of the database itself would drop SQLite's own locks.
#pragma once
#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <string>

namespace echofuse::record {

class WriterLock {
 public:
  // Takes the lock if it is free.
  explicit WriterLock(const std::string& run_path)
      : path_(run_path + "-lock"), fd_(::open(path_.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0644)) {
    held_ = fd_ >= 0 && flock(fd_, LOCK_EX | LOCK_NB) == 0;
  }
  ~WriterLock() {
    if (held_) ::unlink(path_.c_str());
    if (fd_ >= 0) ::close(fd_);
  }
  WriterLock(const WriterLock&) = delete;
  WriterLock& operator=(const WriterLock&) = delete;

  bool held() const { return held_; }

  // Room for a run's last words on a disk that is full by then; as much as the disk gives.
  void reserve(off_t bytes) const {
    if (held_ && posix_fallocate(fd_, 0, bytes) != 0) release();
  }
  void release() const {
    if (held_ && ftruncate(fd_, 0) != 0) return;  // then there is no room: what follows says so
  }

  static bool someone_writes(const std::string& run_path) {
    const int fd = ::open((run_path + "-lock").c_str(), O_RDONLY | O_CLOEXEC);
    if (fd < 0) return false;
    const bool busy = flock(fd, LOCK_SH | LOCK_NB) != 0;
    ::close(fd);
    return busy;
  }

 private:
  std::string path_;
  int fd_;
  bool held_ = false;
};

}  // namespace echofuse::record

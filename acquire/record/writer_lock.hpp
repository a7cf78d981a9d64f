// SPDX-License-Identifier: MIT
// Who is writing a run: the writer holds a lock (file_lock.hpp) on RUN-lock for as long as it
// lives, so that a reader can tell a live run from one that a crash left behind. A separate file,
// because closing any descriptor of the database itself would drop SQLite's own locks. It stays,
// empty.
#pragma once
#include <sys/types.h>

#include <string>

namespace echofuse::record {

class WriterLock {
 public:
  // Takes the lock if it is free. Throws Error: failed if RUN-lock is something else than a lock
  // file (a link, a folder, a file with contents), which is then left alone; disk if it cannot be
  // made.
  explicit WriterLock(const std::string& run_path);
  ~WriterLock();
  WriterLock(const WriterLock&) = delete;
  WriterLock& operator=(const WriterLock&) = delete;

  bool held() const { return held_; }

  // Room for a run's last words on a disk that is full by then; as much as the disk gives.
  void reserve(off_t bytes) const;
  void release() const;

  // Asks without taking the lock, so that no writer finds it taken by a reader.
  static bool someone_writes(const std::string& run_path);

 private:
  int fd_;
  bool held_ = false;
};

}  // namespace echofuse::record

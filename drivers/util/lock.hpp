// SPDX-License-Identifier: MIT
// Lock between processes, implemented as an open file description lock (fcntl) on a separate file.
#pragma once
#include <sys/types.h>

#include <optional>
#include <string>

namespace echofuse {

// Lock on a file, released by the destructor or when the process ends. The empty file remains,
// unless the holder has removed it.
class Lock {
 public:
  // Takes the lock if it is free. A new file gets the permissions `mode`, regardless of the umask.
  // If `mode` is 0, the umask applies and the group may read the file. Throws Error(failed) if PATH
  // is not a lock file (a link, a folder, a file with other contents), and leaves it unchanged.
  // Throws Error(disk) if the file can be neither opened nor created.
  Lock(std::string path, mode_t mode);
  ~Lock();
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;

  bool held() const { return held_; }
  void write(const std::string& text) const;
  // Reserves disk space, so that later writes succeed even if the disk is full. If the full amount
  // cannot be reserved, reserves nothing.
  void reserve(off_t bytes) const;
  void empty() const;
  // Removes the file, but keeps the lock. A process that opened the file before then finds that it
  // is not at PATH, and creates a new one.
  void remove() const;

  // Returns the text written by the lock's holder, or nullopt if the lock is free. Does not take
  // the lock, so concurrent callers do not find the lock held.
  static std::optional<std::string> holder(const std::string& path);

 private:
  [[noreturn]] void fail(const std::string& why) const;
  std::string path_;
  int fd_ = -1;
  bool held_ = false;
};

}  // namespace echofuse

// SPDX-License-Identifier: MIT
// A lock that other programs see: that of an open file description (fcntl) on a file of its own.
#pragma once
#include <sys/types.h>

#include <optional>
#include <string>

namespace echofuse {

// Ends with this object or its process. The file stays, empty, unless its holder removes it.
class Lock {
 public:
  // Takes the lock if it is free. A new file has this mode, whatever the umask; of
  // mode 0 that of the umask, and the group may read it. Throws Error:
  // failed if PATH is something else than a lock file (a link, a folder, a file with contents),
  // which is left alone; disk if the file can neither be opened nor made.
  Lock(std::string path, mode_t mode);
  ~Lock();
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;

  bool held() const { return held_; }
  void write(const std::string& text) const;  // as much as the disk takes
  void reserve(off_t bytes) const;            // room on a disk that is full later; all or nothing
  void empty() const;
  void remove() const;

  // Text of the lock's holder; none: the lock is free. Takes no lock, so that nobody finds it
  // taken.
  static std::optional<std::string> holder(const std::string& path);

 private:
  [[noreturn]] void fail(const std::string& why) const;
  std::string path_;
  int fd_ = -1;
  bool held_ = false;
};

}  // namespace echofuse

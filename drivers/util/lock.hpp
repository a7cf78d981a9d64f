// SPDX-License-Identifier: MIT
// Lock between processes: an open file description lock (fcntl) on a separate file.
#pragma once
#include <sys/types.h>

#include <optional>
#include <string>

namespace echofuse {

// Released by the destructor or at the end of the process. The empty file stays unless the holder
// removes it.
class Lock {
 public:
  // Takes the lock if it is free. A new file gets `mode`, whatever the umask; with mode 0 the umask
  // applies and the group may read.
  // Throws Error(failed) if PATH is not a lock file (a link, a folder, a file with contents), and
  // leaves it unchanged. Throws Error(disk) if the file can neither be opened nor created.
  Lock(std::string path, mode_t mode);
  ~Lock();
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;

  bool held() const { return held_; }
  void write(const std::string& text) const;  // space for later writes; all or nothing
  void reserve(
      off_t bytes) const;  // reserves space for later writes on a full disk; all or nothing
  void empty() const;
  void remove() const;

  // Returns the text of the lock's holder, or nullopt if the lock is free. Does not take the lock,
  // so that concurrent callers do not find it held.
  static std::optional<std::string> holder(const std::string& path);

 private:
  [[noreturn]] void fail(const std::string& why) const;
  std::string path_;
  int fd_ = -1;
  bool held_ = false;
};

}  // namespace echofuse

// SPDX-License-Identifier: MIT
// Locks of an open file description: they end with the last descriptor of it, or with the process.
// A lock's file is never removed, because another program may have it open already.
#pragma once
#include <fcntl.h>

#include <cerrno>

namespace echofuse::record {

inline struct flock whole_file() {
  struct flock lock {};  // such a lock wants 0 as its process
  lock.l_type = F_WRLCK;
  lock.l_whence = SEEK_SET;
  return lock;
}

// 0 if it is ours now, EAGAIN if somebody else has it, or why this file system has no locks.
inline int take_lock(int fd) {
  const struct flock lock = whole_file();
  if (::fcntl(fd, F_OFD_SETLK, &lock) == 0) return 0;
  return errno == EACCES ? EAGAIN : errno;
}

// Asks without taking it, so that nobody finds it taken by who only asks.
inline bool somebody_has_lock(int fd) {
  struct flock lock = whole_file();
  return ::fcntl(fd, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK;
}

}  // namespace echofuse::record

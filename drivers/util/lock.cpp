// SPDX-License-Identifier: MIT
#include "drivers/util/lock.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string_view>
#include <utility>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/new_file.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse {
namespace {

constexpr std::string_view head = "echofuse device lock\n";
constexpr int flags = O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC;
constexpr off_t max_bytes = 1 << 20;

struct flock whole_file() {
  struct flock lock {};  // l_pid must be 0 for F_OFD_SETLK
  lock.l_type = F_WRLCK;
  lock.l_whence = SEEK_SET;
  return lock;
}

// Tries to open the file without O_CREAT first, because in a shared folder the kernel may refuse
// O_CREAT for another user's file.
int open_or_make(const std::string& path, mode_t mode) {
  // repeats the calls, because the lock's holder may remove the file between them
  for (int tries = 0; tries < 10; ++tries) {
    int fd = ::open(path.c_str(), flags | O_RDWR);
    if (fd >= 0 || errno != ENOENT) return fd;
    fd = ::open(path.c_str(), flags | O_RDWR | O_CREAT | O_EXCL, mode ? mode : 0644);
    if (fd >= 0 && mode) static_cast<void>(::fchmod(fd, mode));
    if (fd >= 0 && !mode) let_group_read(fd);
    if (fd >= 0 || errno != EEXIST) return fd;
  }
  return -1;
}

std::string contents(int fd, off_t bytes) {
  std::string text(static_cast<std::size_t>(bytes), '\0');
  text.resize(
      static_cast<std::size_t>(std::max<ssize_t>(::pread(fd, text.data(), text.size(), 0), 0)));
  return text;
}

// Returns true if the file is empty, contains only zeros from reserve(), or begins with the lock's
// header or part of it, because the lock's holder may be writing it.
bool is_ours(int fd) {
  struct stat is {};
  if (::fstat(fd, &is) != 0 || !S_ISREG(is.st_mode) || is.st_nlink > 1 || is.st_size > max_bytes)
    return false;
  const std::string text = contents(fd, is.st_size);
  return text.starts_with(head.substr(0, text.size())) || text.find_first_not_of('\0') == text.npos;
}

bool stands_at(const std::string& path, int fd) {
  struct stat there {
  }, is{};
  return ::lstat(path.c_str(), &there) == 0 && ::fstat(fd, &is) == 0 && there.st_ino == is.st_ino &&
         there.st_dev == is.st_dev;
}

}  // namespace

Lock::Lock(std::string path, mode_t mode) : path_(std::move(path)) {
  while (true) {
    fd_ = open_or_make(path_, mode);
    const bool other = errno == ELOOP || errno == EISDIR || errno == ENXIO || errno == ENODEV;
    if (fd_ < 0 && !other)
      fail(std::string("cannot create the lock file: ") + std::strerror(errno));
    if (fd_ < 0 || !is_ours(fd_)) {
      ::close(fd_);
      throw Error(ExitCode::failed,
                  printable(path_) + ": is not an echofuse lock file; move it away");
    }
    const struct flock lock = whole_file();
    held_ = ::fcntl(fd_, F_OFD_SETLK, &lock) == 0;
    if (!held_ && errno != EAGAIN && errno != EACCES)
      fail(std::string("file system does not support locks: ") + std::strerror(errno));
    if (!held_ || stands_at(path_, fd_)) return;
    ::close(fd_);  // a previous holder has removed this file: try again
  }
}

Lock::~Lock() {
  empty();
  ::close(fd_);
}

void Lock::fail(const std::string& why) const {
  if (fd_ >= 0) ::close(fd_);
  throw Error(ExitCode::disk, printable(path_) + ": " + why);
}

void Lock::write(const std::string& text) const {
  empty();
  const std::string all = std::string(head) + text;
  [[maybe_unused]] const auto written = ::pwrite(fd_, all.data(), all.size(), 0);
}

void Lock::reserve(off_t bytes) const {
  if (held_ && posix_fallocate(fd_, 0, bytes) != 0) empty();
}

void Lock::empty() const {
  if (held_ && ::ftruncate(fd_, 0) != 0) return;  // later writes report a full disk
}

void Lock::remove() const {
  if (held_ && stands_at(path_, fd_)) ::unlink(path_.c_str());
}

std::optional<std::string> Lock::holder(const std::string& path) {
  const int fd = ::open(path.c_str(), flags | O_RDONLY);
  if (fd < 0) return std::nullopt;
  struct flock lock = whole_file();
  std::optional<std::string> out;
  if (::fcntl(fd, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK) out = contents(fd, 8192);
  ::close(fd);
  if (out) out->erase(0, out->starts_with(head) ? head.size() : out->size());
  return out;
}

}  // namespace echofuse

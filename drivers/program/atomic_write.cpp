// SPDX-License-Identifier: MIT
#include "drivers/program/atomic_write.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <random>
#include <utility>

#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse {

UnfinishedFile::UnfinishedFile(const std::string& path) : path_(path) {
  std::random_device random;
  do {
    char name[16];
    std::snprintf(name, sizeof name, ".%08x.part", random());
    part_ = path + name;
    fd_ = ::open(part_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
  } while (fd_ < 0 && errno == EEXIST);
  if (fd_ < 0) fail();
}

UnfinishedFile::~UnfinishedFile() {
  if (fd_ >= 0) ::close(fd_);
  if (!part_.empty()) ::unlink(part_.c_str());
}

void UnfinishedFile::append(std::string_view text) const {
  while (!text.empty()) {
    const ssize_t n = ::write(fd_, text.data(), text.size());
    if (n < 0 && errno != EINTR) fail();
    if (n > 0) text.remove_prefix(static_cast<std::size_t>(n));
  }
}

void UnfinishedFile::publish() {
  if (::close(std::exchange(fd_, -1)) != 0) fail();
  if (std::rename(part_.c_str(), path_.c_str()) != 0) fail();
  part_.clear();
}

void UnfinishedFile::fail() const {
  throw Error(ExitCode::disk, printable(path_) + ": cannot be written: " + std::strerror(errno));
}

void write_atomically(const std::string& path, std::string_view text) {
  UnfinishedFile file(path);
  file.append(text);
  file.publish();
}

void let_group_read(int file) {
  struct stat status {};
  if (::fstat(file, &status) == 0 && !(status.st_mode & S_IRGRP))
    static_cast<void>(::fchmod(file, (status.st_mode & 07777) | S_IRGRP));
}

}  // namespace echofuse

// SPDX-License-Identifier: MIT
#include "drivers/util/regular_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "drivers/util/caused_error.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse {
namespace {

[[noreturn]] void cannot_read(const std::string& path, ExitCode code) {
  const int error = errno;
  throw CausedError(cause_of(error), printable(path) + ": cannot read: " + std::strerror(error),
                    code);
}

// Throws Error(code) unless the file is regular. `failed`: return value of stat() or fstat().
void check_file(int failed, const struct stat& file, const std::string& path, ExitCode code) {
  if (failed) cannot_read(path, code);
  if (S_ISREG(file.st_mode)) return;
  const char* const kind = S_ISDIR(file.st_mode)    ? "a folder"
                           : S_ISFIFO(file.st_mode) ? "a FIFO"
                           : S_ISSOCK(file.st_mode) ? "a socket"
                                                    : "a device";
  throw CausedError(Cause::other_format,
                    printable(path) + ": is " + kind + "; expected a regular file", code);
}

}  // namespace

void require_regular(const std::string& path, ExitCode code) {
  struct stat file {};
  const int failed = ::stat(path.c_str(), &file);
  check_file(failed, file, path, code);
}

std::string real_path(const std::string& path) {
  std::error_code error;
  const auto found = std::filesystem::canonical(path, error);
  return error ? path : found.string();
}

std::vector<std::filesystem::path> entries_of(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> out;
  std::error_code error;
  for (std::filesystem::directory_iterator it(folder, error), end; !error && it != end;
       it.increment(error))
    out.push_back(it->path());
  std::ranges::sort(out);
  return out;
}

// Checks the file before opening it, because opening a device may have side effects. Checks it
// again afterwards, because the file may have been replaced.
RegularFile::RegularFile(const std::string& path, ExitCode code) : path_(path), code_(code) {
  require_regular(path, code);
  fd_ = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
  if (fd_ < 0) cannot_read(path, code);
  struct stat file {};
  try {
    const int failed = ::fstat(fd_, &file);
    check_file(failed, file, path, code);
  } catch (...) {
    ::close(fd_);
    throw;
  }
}

RegularFile::~RegularFile() { ::close(fd_); }

std::size_t RegularFile::size() const {
  struct stat file {};
  return ::fstat(fd_, &file) == 0 ? static_cast<std::size_t>(file.st_size) : 0;
}

std::size_t RegularFile::read(std::span<std::uint8_t> out) const {
  std::size_t done = 0;
  while (done < out.size()) {
    const ssize_t n = ::read(fd_, out.data() + done, out.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) cannot_read(path_, code_);
    if (n == 0) break;
    done += static_cast<std::size_t>(n);
  }
  return done;
}

}  // namespace echofuse

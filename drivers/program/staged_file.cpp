// SPDX-License-Identifier: MIT
#include "drivers/program/staged_file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "drivers/core/crc32c.hpp"
#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"
#include "drivers/program/program.hpp"

namespace echofuse {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const std::string& path, const std::string& reason) {
  throw Error(ExitCode::disk, printable(path) + ": cannot be written: " + reason);
}

// The same name in every process that makes this file; another one for another file. Of machines
// that share a folder each has its own, as locks may not hold between them.
std::string unfinished(const fs::path& place) {
  const std::string whole = fs::absolute(place).lexically_normal().string();
  char hash[12];
  std::snprintf(hash, sizeof hash, "%08x",
                crc32c({reinterpret_cast<const std::uint8_t*>(whole.data()), whole.size()}));
  std::string out = ".";
  for (const std::string& word : {place.filename().string(), std::string("."), machine_name()})
    out += word;
  return out.append("-").append(hash).append(".unfinished");
}

// Where files that are soon removed belong: $TMPDIR, else this folder.
std::string scratch_folder(const std::string& beside) {
  const char* const given = std::getenv("TMPDIR");
  if (given && *given) return given;
  return beside.empty() ? "." : beside;
}

void to_disk(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool done = fd >= 0 && ::fsync(fd) == 0;
  const int reason = errno;
  if (fd >= 0) ::close(fd);
  if (!done) fail(path, std::strerror(reason));
}

}  // namespace

void remove_side_files(const std::string& database) {
  for (const char* beside : {"-journal", "-wal", "-shm"}) ::unlink((database + beside).c_str());
}

StagedFile::StagedFile(const std::string& place)
    : place_(place),
      path_((fs::path(scratch_folder(fs::path(place).parent_path().string())) / unfinished(place))
                .string()) {
  const std::string lock = path_ + ".lock";
  lock_ = ::open(lock.c_str(), O_CREAT | O_RDWR | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (lock_ < 0) fail(place, fs::path(lock).parent_path().string() + ": " + std::strerror(errno));
  if (::flock(lock_, LOCK_EX | LOCK_NB) != 0) {
    ::close(lock_);
    throw Error(ExitCode::failed, printable(place_) + ": another process is making it");
  }
  remove();
}

StagedFile::~StagedFile() {
  remove();
  ::unlink((path_ + ".lock").c_str());
  ::close(lock_);
}

void StagedFile::remove() const {
  for (const char* end : {"", "-lock"}) ::unlink((path_ + end).c_str());
  remove_side_files(path_);
}

void StagedFile::publish() {
  const fs::path folder = fs::path(place_).parent_path();
  const std::string beside = (folder / unfinished(place_)).string();
  std::error_code error;
  if (!fs::equivalent(fs::path(path_).parent_path(), folder.empty() ? "." : folder, error)) {
    fs::copy_file(path_, beside, fs::copy_options::overwrite_existing, error);
    if (error) fail(beside, error.message());
  }
  to_disk(beside);
  remove_side_files(place_);
  if (std::rename(beside.c_str(), place_.c_str()) != 0) fail(place_, std::strerror(errno));
}

}  // namespace echofuse

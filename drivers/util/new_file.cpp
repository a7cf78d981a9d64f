// SPDX-License-Identifier: MIT
#include "drivers/util/new_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <utility>

#include "drivers/core/crc32c.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/lock.hpp"
#include "drivers/util/output_queue.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/program.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse {
namespace {

namespace fs = std::filesystem;

constexpr int flags = O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC;

fs::path folder_of(const std::string& path) {
  const fs::path folder = fs::path(path).parent_path();
  return folder.empty() ? "." : folder;
}

// Returns the name of the unfinished file. All processes that create the same file use the same
// name, and different files have different names. The name contains the machine name, because locks
// may not work between machines that share a folder.
std::string unfinished(const fs::path& place) {
  const std::string whole = fs::absolute(place).lexically_normal().string();
  const std::uint32_t hash =
      crc32c({reinterpret_cast<const std::uint8_t*>(whole.data()), whole.size()});
  return "." + place.filename().string() + "." + machine_name() + format("-%08x.unfinished", hash);
}

// Renames a file without replacing an existing one. If the file system does not support
// RENAME_NOREPLACE, the file is renamed in two steps, which is not atomic.
bool rename_to_new(const char* from, const char* to) {
  if (::renameat2(AT_FDCWD, from, AT_FDCWD, to, RENAME_NOREPLACE) == 0) return true;
  if (errno != EINVAL && errno != ENOSYS) return false;
  if (::access(to, F_OK) == 0) return errno = EEXIST, false;
  return std::rename(from, to) == 0;
}

// Writes the folder to disk, so that a power failure does not undo a rename. Returns true without
// effect if the folder is not readable or its file system does not support fsync of folders.
bool sync_folder(const std::string& path) {
  const int fd = ::open(folder_of(path).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return errno == EACCES;
  const int fault = ::fsync(fd) == 0 ? 0 : errno;
  ::close(fd);
  errno = fault;
  return fault == 0 || fault == EINVAL || fault == ENOTSUP;
}

// Renames a -wal or -journal file that contains data, because it belongs to another database that
// had this name. The -shm file contains no data.
void move_side_files_away(const std::string& database) {
  for (const char* suffix : {"-wal", "-journal"}) {
    const std::string file = database + suffix;
    struct stat found {};
    constexpr off_t header = 32;  // size of a -wal without frames (SQLite file format, section 4.1)
    if (::lstat(file.c_str(), &found) != 0 || found.st_size <= (suffix[1] == 'w' ? header : 0))
      continue;
    std::string kept = file + ".kept";
    for (int n = 2; !rename_to_new(file.c_str(), kept.c_str()); ++n) {
      if (errno != EEXIST)
        throw Error(ExitCode::disk,
                    printable(file) + ": belongs to another run and cannot be renamed");
      kept = file + ".kept-" + std::to_string(n);
    }
    std::fprintf(stderr, "%s: belongs to another run with this name; renamed to %s\n",
                 printable(file).c_str(), printable(kept).c_str());
  }
  remove_side_files(database);
}

// Returns the folder for temporary files: $TMPDIR, or the folder of `place` if TMPDIR is not set.
fs::path scratch_folder(const std::string& place) {
  if (!fs::is_directory(folder_of(place)))
    throw Error(ExitCode::disk, printable(place) + ": its folder does not exist");
  const char* const given = std::getenv("TMPDIR");
  return given && *given ? fs::path(given) : folder_of(place);
}

}  // namespace

NewFile::NewFile(std::string place) : place_(std::move(place)) {
  std::random_device random;
  do {
    path_ = place_ + format(".%08x.part", random());
    fd_ = ::open(path_.c_str(), flags, 0666);
  } while (fd_ < 0 && errno == EEXIST);
  if (fd_ < 0) fail();
}

NewFile::NewFile(std::string place, std::string path)
    : place_(std::move(place)), path_(std::move(path)), database_(true) {
  remove();
}

NewFile::NewFile(const std::string& place, Staged)
    : place_(place),
      path_((scratch_folder(place) / unfinished(place)).string()),
      lock_(std::make_unique<Lock>(path_ + ".lock", 0600)),
      database_(true) {
  if (!lock_->held())
    throw Error(ExitCode::failed, printable(place_) + ": another process is creating this file");
  remove();
}

NewFile::~NewFile() {
  if (fd_ >= 0) ::close(fd_);
  if (!path_.empty() && !keep_) remove();
  if (lock_) lock_->remove();
}

void NewFile::remove() const {
  ::unlink(path_.c_str());
  if (!database_) return;
  ::unlink((path_ + "-lock").c_str());
  remove_side_files(path_);
}

void NewFile::create() {
  fd_ = ::open(path_.c_str(), flags, 0644);
  if (fd_ < 0) fail();
  let_group_read(fd_);  // SQLite copies these permissions to the -wal and -shm files
}

void NewFile::append(std::string_view text) {
  if (const int error = write_all(fd_, text); error != 0) errno = error, fail();
}

void NewFile::append_file(const std::string& path) {
  const RegularFile file(path, ExitCode::disk);
  std::string block(1 << 20, '\0');
  while (const std::size_t bytes =
             file.read({reinterpret_cast<std::uint8_t*>(block.data()), block.size()}))
    append({block.data(), bytes});
}

void NewFile::publish() { static_cast<void>(move(true)); }

bool NewFile::publish_new() { return move(false); }

bool NewFile::move(bool over) {
  if (fd_ >= 0 && ::fsync(fd_) != 0) fail();
  if (fd_ >= 0 && ::close(std::exchange(fd_, -1)) != 0) fail();
  std::error_code error;
  if (database_ && !fs::equivalent(folder_of(path_), folder_of(place_), error)) {
    NewFile copy(place_, (fs::path(place_).parent_path() / unfinished(place_)).string());
    copy.create();
    copy.append_file(path_);
    return copy.move(over);
  }
  if (database_) {
    fd_ = ::open(path_.c_str(), O_RDONLY | O_CLOEXEC);
    if (fd_ < 0 || ::fsync(fd_) != 0) fail();
    ::close(std::exchange(fd_, -1));
    if (!over && ::access(place_.c_str(), F_OK) == 0) return false;
    move_side_files_away(place_);
  }
  const bool moved = over ? std::rename(path_.c_str(), place_.c_str()) == 0
                          : rename_to_new(path_.c_str(), place_.c_str());
  if (!moved && (over || errno != EEXIST)) fail();
  if (moved && !sync_folder(place_)) fail();
  if (moved) remove(), path_.clear();
  return moved;
}

void NewFile::fail() const {
  throw Error(ExitCode::disk, printable(place_) + ": cannot be written: " + std::strerror(errno));
}

void refuse_run_or_model(const std::string& path) {
  std::error_code none;
  if (!fs::is_regular_file(path, none)) return;
  std::string start(9, '\0');
  std::ifstream(path, std::ios::binary).read(start.data(), std::ssize(start));
  // A model begins with the length of its header, 8 bytes, and "{".
  const bool run = start.starts_with("SQLite"),
             model = start.ends_with(std::string("\0\0\0\0{", 5));
  if (run || model)
    throw Error(ExitCode::usage, printable(path) + ": is a " + (run ? "run" : "model") +
                                     "; choose another name for the output");
}

void write_atomically(const std::string& path, std::string_view text) {
  refuse_run_or_model(path);
  NewFile file(path);
  file.append(text);
  file.publish();
}

void sync_file(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool done = fd >= 0 && ::fsync(fd) == 0;
  const int fault = errno;
  if (fd >= 0) ::close(fd);
  if (!done)
    throw Error(ExitCode::disk, printable(path) + ": cannot be written: " + std::strerror(fault));
}

void let_group_read(int file) {
  struct stat status {};
  if (::fstat(file, &status) == 0 && !(status.st_mode & S_IRGRP))
    static_cast<void>(::fchmod(file, (status.st_mode & 07777) | S_IRGRP));
}

void remove_side_files(const std::string& database) {
  for (const char* suffix : {"-journal", "-wal", "-shm"}) ::unlink((database + suffix).c_str());
}

}  // namespace echofuse

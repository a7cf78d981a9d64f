// SPDX-License-Identifier: MIT
#include "acquire/record/file_watch.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace echofuse::record {

FileWatch::FileWatch(std::string path) : path_(std::move(path)) {
  for (WatchedFile& file : files_) {
    struct stat now {};
    if (::stat((path_ + file.suffix).c_str(), &now) != 0) continue;
    file.device = now.st_dev;
    file.inode = now.st_ino;
  }
  note();
  note_commit();
}

std::string FileWatch::lost() const {
  for (const WatchedFile& file : files_) {
    const std::string what = *file.suffix ? std::string("its ") + file.suffix + " file " : "";
    const int fault = fault_of(file);
    if (fault == ENOENT || fault == ENOTDIR) return what + "was removed or renamed during the run";
    if (fault == ESTALE) return what + "was replaced by another file during the run";
    if (fault != 0) return what + "cannot be accessed: " + std::strerror(fault);
  }
  return {};
}

// Returns 0 if the path still leads to the file that was opened, ESTALE if it leads to another
// file, otherwise the errno of stat().
int FileWatch::fault_of(const WatchedFile& file) const {
  struct stat now {};
  if (::stat((path_ + file.suffix).c_str(), &now) != 0) return errno;
  return now.st_dev == file.device && now.st_ino == file.inode ? 0 : ESTALE;
}

bool FileWatch::touched() const {
  struct stat now {};
  if (::stat(path_.c_str(), &now) != 0) return true;
  return now.st_size != files_[0].size || now.st_mtim.tv_sec != written_.tv_sec ||
         now.st_mtim.tv_nsec != written_.tv_nsec;
}

void FileWatch::note() {
  struct stat now {};
  if (::stat(path_.c_str(), &now) != 0) return;
  written_ = now.st_mtim;
  files_[0].size = now.st_size;
  files_[1].size = 0;
}

void FileWatch::note_commit() {
  for (WatchedFile* file : {&files_[1], &files_[2]}) file->size = size_of(*file);
}

bool FileWatch::wal_shortened() const { return size_of(files_[1]) < files_[1].size; }

void FileWatch::restore_index() const {
  const WatchedFile& index = files_[2];
  if (fault_of(index) == 0 && size_of(index) < index.size)
    static_cast<void>(::truncate((path_ + index.suffix).c_str(), index.size));
}

off_t FileWatch::size_of(const WatchedFile& file) const {
  struct stat now {};
  return ::stat((path_ + file.suffix).c_str(), &now) == 0 ? now.st_size : 0;
}

void FileWatch::remove_wal() const {
  for (const WatchedFile& file : files_)
    if (*file.suffix && fault_of(file) == 0) ::unlink((path_ + file.suffix).c_str());
}

}  // namespace echofuse::record

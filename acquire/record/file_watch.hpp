// SPDX-License-Identifier: MIT
// Whether the files that SQLite has open are still those that their names mean, and whether
// somebody else wrote into the database. What is removed or replaced is written on without an
// error, and gone at the end.
#pragma once
#include <sys/types.h>

#include <string>

namespace echofuse::record {

class FileWatch {
 public:
  // Of a database that is open and has a WAL.
  explicit FileWatch(std::string path);

  // What happened to the database, its WAL or the WAL's index; empty if they are still the same.
  std::string lost() const;
  // The database was written to since note(), which we say after each of our checkpoints.
  bool touched() const;
  void note();

  // The database's name means the file that it meant.
  bool same_database() const { return fault_of(files_[0]) == 0; }
  // Removes WAL and index if they are still ours: beside another database they would be taken for
  // its own.
  void remove_wal() const;

 private:
  struct File {
    const char* suffix;
    dev_t device = 0;
    ino_t inode = 0;
  };
  int fault_of(const File& file) const;
  std::string path_;
  File files_[3] = {{""}, {"-wal"}, {"-shm"}};
  timespec written_{};
  off_t size_ = 0;
};

}  // namespace echofuse::record

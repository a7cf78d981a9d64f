// SPDX-License-Identifier: MIT
// Detects that SQLite's open files were removed, replaced or shortened, and writes of others.
// SQLite goes on writing into such files without an error, and the data are gone at the end.
#pragma once
#include <sys/types.h>

#include <string>

namespace echofuse::record {

class FileWatch {
 public:
  // Needs the database open, with a WAL.
  explicit FileWatch(std::string path);

  // Fault of the database, its WAL or the WAL's index; empty if they are still the same files.
  std::string lost() const;
  // The database was written to since note(), which we say after each of our checkpoints. After one
  // that took over the whole WAL nothing is lost with it.
  bool touched() const;
  void note();
  // Notes a commit of ours: from now on WAL and index must not get shorter.
  void note_commit();
  // The WAL is shorter than at note_commit(). Another program's checkpoint shortens it, too, but
  // touches the database before.
  bool wal_shortened() const;
  // Gives the index its length again, before SQLite reads it in memory and is killed by SIGBUS.
  // SQLite finds zeros there and makes the index anew, from the WAL.
  void restore_index() const;

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
    off_t size = 0;  // size of WAL and index at note_commit()
  };
  int fault_of(const File& file) const;
  off_t size_of(const File& file) const;
  std::string path_;
  File files_[3] = {{""}, {"-wal"}, {"-shm"}};
  timespec written_{};
};

}  // namespace echofuse::record

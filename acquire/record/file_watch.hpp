// SPDX-License-Identifier: MIT
// Detects that SQLite's open files were removed, replaced or truncated, and writes by others.
// SQLite continues to write to such files without an error, and the data are lost at the end.
#pragma once
#include <sys/types.h>

#include <string>

namespace echofuse::record {

class FileWatch {
 public:
  // Requires the open database, with a WAL.
  explicit FileWatch(std::string path);

  // Returns the fault of the database, its WAL or the WAL's index; empty if they are still the same
  // files.
  std::string lost() const;
  // Returns true if the database was written since note(), which is called after each of our
  // checkpoints. After a checkpoint of the whole WAL no data are lost with it.
  bool touched() const;
  void note();
  // Notes our commit: WAL and index must not become shorter afterwards.
  void note_commit();
  // Returns true if the WAL is shorter than at note_commit(). Another program's checkpoint also
  // truncates it, but writes to the database first.
  bool wal_shortened() const;
  // Restores the length of the index before SQLite accesses its mapped memory, which would raise
  // SIGBUS. SQLite then reads zeros and rebuilds the index from the WAL.
  void restore_index() const;

  // Returns true if the database's path still is the same file.
  bool same_database() const { return fault_of(files_[0]) == 0; }
  // Removes WAL and index if they are still ours. Next to another database they would be applied to
  // it.
  void remove_wal() const;

 private:
  struct WatchedFile {
    const char* suffix;
    dev_t device = 0;
    ino_t inode = 0;
    off_t size = 0;  // sizes of WAL and index at note_commit()
  };
  int fault_of(const WatchedFile& file) const;
  off_t size_of(const WatchedFile& file) const;
  std::string path_;
  WatchedFile files_[3] = {{""}, {"-wal"}, {"-shm"}};
  timespec written_{};
};

}  // namespace echofuse::record

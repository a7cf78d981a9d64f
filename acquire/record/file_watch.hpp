// SPDX-License-Identifier: MIT
// Detects that files opened by SQLite were removed, replaced or truncated, or changed by another
// program. SQLite would continue to write to such files without an error, and the data would be
// lost when they are closed.
#pragma once
#include <sys/types.h>

#include <string>

namespace echofuse::record {

class FileWatch {
 public:
  // The database must be open and have a WAL.
  explicit FileWatch(std::string path);

  // Returns an error message if the database file, its WAL or the WAL index has been removed or
  // replaced; otherwise an empty string.
  std::string lost() const;
  // Returns true if the database file has changed since note().
  bool touched() const;
  // Must be called after each checkpoint by this process. From then on, the WAL may become shorter,
  // because the database contains its data.
  void note();
  // Must be called after each commit by this process. From then on, the WAL and its index must not
  // become shorter.
  void note_commit();
  // Returns true if the WAL has become shorter since note_commit(). A checkpoint by another program
  // may also truncate the WAL. It changes the database first, so touched() then returns true.
  bool wal_shortened() const;
  // Restores the length of a truncated index. Otherwise SQLite would raise SIGBUS when it accesses
  // the mapped file. SQLite reads the restored part as zeros and rebuilds the index from the WAL.
  void restore_index() const;

  // Returns true if the path of the database still leads to the file that was opened.
  bool same_database() const { return fault_of(files_[0]) == 0; }
  // Removes the WAL and its index, unless they have been replaced by other files. Otherwise SQLite
  // would apply them to another database at this path.
  void remove_wal() const;

 private:
  struct WatchedFile {
    const char* suffix;
    dev_t device = 0;
    ino_t inode = 0;
    off_t size = 0;  // file size at the last note() or note_commit(), bytes
  };
  int fault_of(const WatchedFile& file) const;
  off_t size_of(const WatchedFile& file) const;
  std::string path_;
  WatchedFile files_[3] = {{""}, {"-wal"}, {"-shm"}};
  timespec written_{};
};

}  // namespace echofuse::record

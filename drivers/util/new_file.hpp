// SPDX-License-Identifier: MIT
// Files that are published atomically: the path holds the complete old file or the complete new
// one.
#pragma once
#include <memory>
#include <string>
#include <string_view>

namespace echofuse {

class Lock;

// Threading: one thread at a time.
class NewFile {
 public:
  // Writes to PLACE.RANDOM.part, so that no existing link is followed. A killed process leaves this
  // file.
  explicit NewFile(std::string place);
  // Writes to `path`, which must not be used by other processes. Removes a file that a killed
  // process left there. May be a database, which must not inherit the side files of an older one.
  NewFile(std::string place, std::string path);
  // Writes in $TMPDIR on a local disk, because SQLite's WAL does not work on network file systems.
  // Without TMPDIR it writes in the folder of `place`. Restarts a file that a killed process left.
  // Throws Error(failed) if another process of this machine creates the same file.
  struct Staged {};
  NewFile(const std::string& place, Staged);
  ~NewFile();  // removes an unpublished file
  NewFile(const NewFile&) = delete;
  NewFile& operator=(const NewFile&) = delete;

  const std::string& path() const { return path_; }  // path of the unpublished file
  const std::string& place() const { return place_; }
  void create();                       // creates it empty; throws Error(disk)
  void append(std::string_view text);  // throws Error(disk)
  void keep() { keep_ = true; }        // keeps an unpublished file
  // Moves the file, which must be closed everywhere, to its place and replaces an existing file.
  // File and name are then on disk: fsync of the file, rename, fsync of the folder. Renames a -wal
  // or -journal of another database at its place, with a warning. Throws Error(disk).
  void publish();
  // Publishes without replacing: returns false if the place is taken. Takes two steps on some file
  // systems.
  bool publish_new();

 private:
  bool move(bool over);
  void remove() const;
  [[noreturn]] void fail() const;
  std::string place_, path_;
  std::unique_ptr<Lock> lock_;
  int fd_ = -1;
  bool database_ = false, keep_ = false;
};

// Writes the whole file. On failure PATH is unchanged. Throws Error(disk).
void write_atomically(const std::string& path, std::string_view text);

// Waits until the written data are on the disk. Throws Error(disk).
void sync_file(const std::string& path);

// Adds read permission for the file's group, whatever the umask, because a measuring PC has several
// users. Skips files of other users.
void let_group_read(int file);

// Removes SQLite's side files of this database name. SQLite would apply those of an older database
// to the new one.
void remove_side_files(const std::string& database);

}  // namespace echofuse

// SPDX-License-Identifier: MIT
// Files that are published atomically: at any time the path contains the complete old file or the
// complete new file.
#pragma once
#include <memory>
#include <string>
#include <string_view>

namespace echofuse {

class Lock;

// A file that is written under another name until it is complete. Threading: use it on one thread
// at a time.
class NewFile {
 public:
  // Writes to PLACE.RANDOM.part. The random name ensures that no existing link is followed. If the
  // process is killed, this file remains.
  explicit NewFile(std::string place);
  // Writes to `path`, which must not be used by other processes. Removes a file left there by a
  // killed process, and the side files of an older database.
  NewFile(std::string place, std::string path);
  // Writes to a file in $TMPDIR on a local disk, because SQLite's WAL does not work on network file
  // systems. If TMPDIR is not set, writes in the folder of `place`. Overwrites a file left by a
  // killed process. Throws Error(failed) if another process on this machine is creating the same
  // file.
  struct Staged {};
  NewFile(const std::string& place, Staged);
  ~NewFile();  // removes the file unless it has been published or kept
  NewFile(const NewFile&) = delete;
  NewFile& operator=(const NewFile&) = delete;

  const std::string& path() const { return path_; }  // path of the unpublished file
  const std::string& place() const { return place_; }
  void create();                              // creates an empty file; throws Error(disk)
  void append(std::string_view text);         // throws Error(disk)
  void append_file(const std::string& path);  // throws Error(disk)
  void keep() { keep_ = true; }               // the destructor does not remove the file
  // Moves the file to `place` and replaces an existing file. No process may have the file open. On
  // return, the contents and the name are on the disk: fsync of the file, rename, fsync of the
  // folder. If another database left a -wal or -journal file there, renames it with a warning.
  // Throws Error(disk).
  void publish();
  // Like publish(), but returns false if `place` already exists. On some file systems, this is not
  // atomic.
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

// Throws Error(usage) if the file is a run or a model, which other output must not replace.
void refuse_run_or_model(const std::string& path);

// Writes the whole file atomically. If this fails, PATH is unchanged and Error(disk) is thrown.
// Throws Error(usage) if the file is a run or a model.
void write_atomically(const std::string& path, std::string_view text);

// Waits until the file's data have been written to the disk. Throws Error(disk).
void sync_file(const std::string& path);

// Allows the file's group to read the file, regardless of the umask, because a measuring PC has
// several users. Has no effect on files owned by other users.
void let_group_read(int file);

// Removes SQLite's side files of this database. Otherwise, SQLite would apply the side files of an
// older database to a new one with the same name.
void remove_side_files(const std::string& database);

}  // namespace echofuse

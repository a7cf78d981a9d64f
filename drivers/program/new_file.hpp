// SPDX-License-Identifier: MIT
// Files that appear at their place as a whole: what stands there is the old file or the new one.
#pragma once
#include <memory>
#include <string>
#include <string_view>

namespace echofuse {

class Lock;

// Threading: one thread at a time.
class NewFile {
 public:
  // Grows as PLACE.RANDOM.part: no link that was put there before is followed. A killed process
  // leaves it.
  explicit NewFile(std::string place);
  // Grows at `path`, which nobody else uses; nothing is there yet. Removes a file that a killed
  // process left there. May be a database, which takes no side files of a former one.
  NewFile(std::string place, std::string path);
  // Grows in $TMPDIR, on a disk of this machine, because SQLite's WAL does not work on a network.
  // Grows beside its place without TMPDIR. A file that a killed process left is begun anew. Throws
  // Error(failed) if another process of this machine is making the same file.
  struct Staged {};
  NewFile(const std::string& place, Staged);
  ~NewFile();  // removes what was not published
  NewFile(const NewFile&) = delete;
  NewFile& operator=(const NewFile&) = delete;

  const std::string& path() const { return path_; }  // file while it grows
  const std::string& place() const { return place_; }
  void create();                       // makes it, empty; throws Error(disk)
  void append(std::string_view text);  // throws Error(disk)
  void keep() { keep_ = true; }        // leaves what was not published
  // Moves the file, which nobody holds open any more, to its place, over what is there. The file
  // and its name are on the disk then: fsync of the file, rename, fsync of the folder. A database
  // gives the -wal or -journal of another one at its place another name, and warns. Throws
  // Error(disk).
  void publish();
  // Publishes, but returns false if something is there. Two steps on some file systems.
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

// The whole file. If it cannot be written, PATH is as before. Throws Error(disk).
void write_atomically(const std::string& path, std::string_view text);

// Waits until what was written to this file is on the disk. Throws Error(disk).
void sync_file(const std::string& path);

// Adds the permission to read for the file's group, whatever the umask says: a measuring PC has
// several users. Does nothing to a file of others.
void let_group_read(int file);

// Removes what SQLite keeps beside a database of this name. Left there by another one, it would be
// taken for the new one's.
void remove_side_files(const std::string& database);

}  // namespace echofuse

// SPDX-License-Identifier: MIT
// A file that appears at its place only when it is whole. Until then it grows in $TMPDIR, on a disk
// of this machine: SQLite's WAL does not work on a network. Without TMPDIR it grows beside its
// place.
#pragma once
#include <string>

namespace echofuse {

// A process that died leaves its unfinished file; the next one that makes the same file on this
// machine begins it anew. Threading: one thread at a time.
class StagedFile {
 public:
  // Throws Error: failed if another process of this machine is making the same file; disk.
  explicit StagedFile(const std::string& place);
  ~StagedFile();  // removes what was not published
  StagedFile(const StagedFile&) = delete;
  StagedFile& operator=(const StagedFile&) = delete;

  const std::string& path() const { return path_; }  // where it grows; nothing is there yet
  const std::string& place() const { return place_; }
  // Moves the file, which nobody holds open any more, to its place, over what is there, whose side
  // files it removes. Throws Error(disk).
  void publish();

 private:
  void remove() const;
  std::string place_, path_;
  int lock_ = -1;
};

// Removes what SQLite keeps beside a database of this name. Left there by another one, it would be
// taken for the new one's.
void remove_side_files(const std::string& database);

}  // namespace echofuse

// SPDX-License-Identifier: MIT
// Files that are replaced as a whole: what stands at a path is the old file or the new one. Who may
// read them.
#pragma once
#include <string>
#include <string_view>

namespace echofuse {

// A new file beside PATH, of a name that nobody can foresee (PATH.RANDOM.part): no link that was
// put there before is followed. A killed process leaves it.
class UnfinishedFile {
 public:
  explicit UnfinishedFile(const std::string& path);  // empty; throws Error(disk)
  ~UnfinishedFile();                                 // removes what was not published
  UnfinishedFile(const UnfinishedFile&) = delete;
  UnfinishedFile& operator=(const UnfinishedFile&) = delete;
  const std::string& path() const { return part_; }  // where it grows
  void append(std::string_view text) const;          // throws Error(disk)
  // Renames it to PATH, over what is there. Throws Error(disk).
  void publish();

 private:
  [[noreturn]] void fail() const;
  std::string path_, part_;
  int fd_ = -1;
};

// The whole file. If it cannot be written, PATH is as before. Throws Error(disk).
void write_atomically(const std::string& path, std::string_view text);

// Adds the permission to read for the file's group, whatever the umask says: a measuring PC has
// several users. Does nothing to a file of others.
void let_group_read(int file);

}  // namespace echofuse

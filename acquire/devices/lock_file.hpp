// SPDX-License-Identifier: MIT
// A lock that other programs see, with the name of who holds it.
#pragma once
#include <optional>
#include <string>
#include <vector>

namespace echofuse::acquire {

struct Holder {
  std::string who;  // "echofuse-acquire run, pid 4711, run /data/monday.sqlite"
  std::string run;  // the run file that it writes; empty: none
};

// A folder that all users share, so that they see each other's locks; $ECHOFUSE_LOCKS, if it is
// set.
std::string lock_folder();

// The holders of all locks in it. Takes none.
std::vector<Holder> holders_in(const std::string& folder);

// A lock on FOLDER/NAME: it ends with this object, or with the process. The file stays, empty.
class LockFile {
 public:
  // Takes the lock if it is free. Throws Error(device) if the file can neither be made nor opened,
  // or is no ordinary file: a link is not followed, and nothing but a lock file of ours written to.
  LockFile(const std::string& folder, const std::string& name, const Holder& me);
  ~LockFile();
  LockFile(const LockFile&) = delete;
  LockFile& operator=(const LockFile&) = delete;

  // Who else holds it; none: we do.
  const std::optional<Holder>& other() const { return other_; }

 private:
  void open_file();
  void write(const Holder& me) const;

  std::string path_;
  int fd_ = -1;
  std::optional<Holder> other_;
};

}  // namespace echofuse::acquire

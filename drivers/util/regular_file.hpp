// SPDX-License-Identifier: MIT
// Input files, which must be regular: a FIFO would block until a writer opens it, and a device may
// have no end.
#pragma once
#include <algorithm>
#include <cstdint>
#include <span>
#include <string>

#include "drivers/util/exit_code.hpp"

namespace echofuse {

// Throws Error(code), "PATH: is a FIFO; expected a regular file", unless PATH is a regular file or
// a link to one. Does not open the file: closing any descriptor of a database would release
// SQLite's locks of this process.
void require_regular(const std::string& path, ExitCode code);

// Path of the file behind links, or PATH if nothing is there. SQLite makes -wal and -journal next
// to that file.
std::string real_path(const std::string& path);

// Regular file, open for reading. Does not block if the file is replaced by a FIFO during the
// check.
class RegularFile {
 public:
  RegularFile(const std::string& path, ExitCode code);
  ~RegularFile();
  RegularFile(const RegularFile&) = delete;
  RegularFile& operator=(const RegularFile&) = delete;
  std::size_t size() const;
  // Fills `out` with the next bytes. Returns their number, which is smaller at the end. Throws
  // Error(code).
  std::size_t read(std::span<std::uint8_t> out) const;
  // Reads the rest as std::string or Bytes: at most `most` + 1 bytes, so that the caller detects a
  // longer file.
  template <class Contents>
  Contents rest(std::size_t most = std::size_t{1} << 62) const {
    Contents out;
    for (std::size_t done = 0; done <= most;) {
      // Reads one extra byte to find the end, because kernel files (/proc, /sys) report size 0.
      out.resize(std::min(std::max(size(), done + 4096), most) + 1);
      done += read({reinterpret_cast<std::uint8_t*>(out.data()) + done, out.size() - done});
      if (done == out.size()) continue;
      out.resize(done);
      break;
    }
    return out;
  }

 private:
  std::string path_;
  ExitCode code_;
  int fd_;
};

}  // namespace echofuse

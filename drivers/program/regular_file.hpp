// SPDX-License-Identifier: MIT
// Files that are read: regular ones alone. In place of one, a FIFO keeps a program waiting for a
// writer, and a device may have no end.
#pragma once
#include <algorithm>
#include <cstdint>
#include <span>
#include <string>

#include "drivers/program/exit_code.hpp"

namespace echofuse {

// Throws Error(code), "PATH: is a FIFO; expected a regular file", unless one is there, or a link to
// one. Opens nothing, because SQLite opens files by name. SQLite's locks on a file end when the
// process closes any descriptor of it.
void require_regular(const std::string& path, ExitCode code);

// Regular file, open for reading. A file put in its place meanwhile does not make it wait.
class RegularFile {
 public:
  RegularFile(const std::string& path, ExitCode code);
  ~RegularFile();
  RegularFile(const RegularFile&) = delete;
  RegularFile& operator=(const RegularFile&) = delete;
  std::size_t size() const;
  // Fills `out` with the next bytes. Returns how many: fewer at the end. Throws Error(code).
  std::size_t read(std::span<std::uint8_t> out) const;
  // Reads the rest as a std::string or Bytes: `most` bytes, and one more if there are more.
  template <class Contents>
  Contents rest(std::size_t most = std::size_t{1} << 62) const {
    Contents out;
    for (std::size_t done = 0; done <= most;) {
      // Reads one byte more to find the end, because files of the kernel state size 0.
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

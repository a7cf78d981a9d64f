// SPDX-License-Identifier: MIT
// Input files, which must be regular: a FIFO would block until a writer opens it, and reading
// a device may never end.
#pragma once
#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "drivers/util/exit_code.hpp"

namespace echofuse {

// Throws Error(code), "PATH: is a FIFO; expected a regular file", unless PATH is a regular file or
// a link to one. Does not open the file, because closing a descriptor of a database releases this
// process's SQLite locks.
void require_regular(const std::string& path, ExitCode code);

// Resolves symbolic links in PATH. Returns PATH if it does not exist. SQLite creates its -wal and
// -journal files next to the resolved file.
std::string real_path(const std::string& path);

// Returns the entries of a folder, sorted so that a listing does not depend on the file system.
// Returns an empty list if the folder cannot be read.
std::vector<std::filesystem::path> entries_of(const std::filesystem::path& folder);

// A regular file that is open for reading. Opening it does not block, even if the file is replaced
// by a FIFO after the check.
class RegularFile {
 public:
  RegularFile(const std::string& path, ExitCode code);
  ~RegularFile();
  RegularFile(const RegularFile&) = delete;
  RegularFile& operator=(const RegularFile&) = delete;
  std::size_t size() const;
  // Fills `out` with the next bytes of the file. Returns the number of bytes read, which is less
  // than the size of `out` only at the end of the file. Throws Error(code).
  std::size_t read(std::span<std::uint8_t> out) const;
  // Reads the rest of the file into a std::string or Bytes. Reads at most `max_bytes` + 1 bytes, so
  // that the caller can detect a longer file.
  template <class Contents>
  Contents rest(std::size_t max_bytes = std::size_t{1} << 62) const {
    Contents out;
    for (std::size_t done = 0; done <= max_bytes;) {
      // Reads one extra byte to find the end, because kernel files (/proc, /sys) report size 0.
      out.resize(std::min(std::max(size(), done + 4096), max_bytes) + 1);
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

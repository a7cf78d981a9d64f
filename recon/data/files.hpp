// SPDX-License-Identifier: MIT
// These functions read and write whole files, with errors that name them.
#pragma once
#include <string>

#include "drivers/core/bytes.hpp"

namespace echofuse::recon {

Bytes read_file(const std::string& path);                     // throws Error(failed)
std::string read_text(const std::string& path);               // throws Error(failed)
void write_file(const std::string& path, ByteView contents);  // as write_atomically()
void make_folder(const std::string& path);                    // throws Error(disk)

// It is removed again at the end, with the files that SQLite and a run's writer keep beside a run
// file.
struct TemporaryFile {
  std::string path;
  ~TemporaryFile();
};

}  // namespace echofuse::recon

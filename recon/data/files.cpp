// SPDX-License-Identifier: MIT
#include "recon/data/files.hpp"

#include <cstdio>
#include <filesystem>

#include "drivers/program/exit_code.hpp"
#include "drivers/program/new_file.hpp"
#include "drivers/program/regular_file.hpp"

namespace echofuse::recon {

Bytes read_file(const std::string& path) {
  return RegularFile(path, ExitCode::failed).rest<Bytes>();
}

std::string read_text(const std::string& path) {
  return RegularFile(path, ExitCode::failed).rest<std::string>();
}

void write_file(const std::string& path, ByteView contents) {
  write_atomically(path, {reinterpret_cast<const char*>(contents.data()), contents.size()});
}

void make_folder(const std::string& path) {
  std::error_code code;
  std::filesystem::create_directories(path, code);
  if (code) throw Error(ExitCode::disk, path + ": cannot make this folder: " + code.message());
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include "recon/data/files.hpp"

#include <cstdio>
#include <filesystem>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/new_file.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::recon {

Bytes read_file(const std::string& path) {
  return RegularFile(path, ExitCode::failed).rest<Bytes>();
}

std::string read_text(const std::string& path) {
  std::string text = RegularFile(path, ExitCode::failed).rest<std::string>();
  std::erase(text, '\r');
  return text.starts_with("\xef\xbb\xbf") ? text.substr(3) : text;
}

void write_file(const std::string& path, ByteView contents) {
  write_atomically(path, {reinterpret_cast<const char*>(contents.data()), contents.size()});
}

void make_folder(const std::string& path) {
  std::error_code code;
  std::filesystem::create_directories(path, code);
  if (code) throw Error(ExitCode::disk, path + ": cannot create the folder: " + code.message());
}

std::vector<std::string> csv_fields(const std::string& line) {
  std::vector<std::string> out(1);
  bool quoted = false;
  for (const char c : line) {
    if (c == '"')
      quoted = !quoted;
    else if (c == ',' && !quoted)
      out.emplace_back();
    else
      out.back() += c;
  }
  return out;
}

}  // namespace echofuse::recon

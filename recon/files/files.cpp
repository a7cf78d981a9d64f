// SPDX-License-Identifier: MIT
#include "recon/files/files.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "drivers/core/exit_code.hpp"

namespace echofuse::recon {

Bytes read_file(const std::string& path) {
  std::error_code code;
  const auto kind = std::filesystem::status(path, code).type();
  if (kind != std::filesystem::file_type::regular && kind != std::filesystem::file_type::not_found)
    throw Error(ExitCode::failed, path + ": is no file; expected one");  // a device may be endless
  std::ifstream in(path, std::ios::binary);
  Bytes out((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  if (!in) throw Error(ExitCode::failed, path + ": " + std::strerror(errno));
  return out;
}

std::string read_text(const std::string& path) {
  const Bytes bytes = read_file(path);
  return {bytes.begin(), bytes.end()};
}

void write_file(const std::string& path, ByteView contents) {
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out.write(reinterpret_cast<const char*>(contents.data()),
            static_cast<std::streamsize>(contents.size()));
  out.close();
  if (!out) throw Error(ExitCode::disk, path + ": cannot write: " + std::strerror(errno));
}

void write_text(const std::string& path, const std::string& text) {
  write_file(path, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

TemporaryFile::~TemporaryFile() {
  for (const char* beside : {"", "-wal", "-shm", "-lock"}) std::remove((path + beside).c_str());
}

void make_folder(const std::string& path) {
  std::error_code code;
  std::filesystem::create_directories(path, code);
  if (code) throw Error(ExitCode::disk, path + ": cannot make this folder: " + code.message());
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include "drivers/core/atomic_write.hpp"

#include <sys/stat.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>

#include "drivers/core/exit_code.hpp"

namespace echofuse {
namespace {

[[noreturn]] void fail(const std::string& path) {
  throw Error(ExitCode::disk, path + ": cannot be written: " + std::strerror(errno));
}

}  // namespace

void write_atomically(const std::string& path,
                      const std::function<void(const std::string& part)>& write) {
  const std::string part = path + ".part";
  write(part);
  if (std::rename(part.c_str(), path.c_str()) != 0) fail(path);
}

void write_atomically(const std::string& path, std::string_view text) {
  write_atomically(path, [&](const std::string& part) {
    std::ofstream out(part, std::ios::binary);
    out << text;
    out.close();
    if (!out) fail(path);
  });
}

void let_group_read(int file) {
  struct stat status {};
  if (::fstat(file, &status) == 0 && !(status.st_mode & S_IRGRP))
    static_cast<void>(::fchmod(file, (status.st_mode & 07777) | S_IRGRP));
}

}  // namespace echofuse

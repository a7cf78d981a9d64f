// SPDX-License-Identifier: MIT
#include "recon/numbers/table_memory.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <mutex>
#include <new>
#include <set>
#include <string>

#include "drivers/core/exit_code.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t least_counted = std::size_t{1} << 20;

struct Tables {
  std::mutex mutex;
  std::size_t limit = static_cast<std::size_t>(sysconf(_SC_PHYS_PAGES)) *
                      static_cast<std::size_t>(sysconf(_SC_PAGESIZE)) / 2;
  std::size_t in_memory = 0, on_disk = 0;
  std::set<const void*> files;
};
Tables& tables() {
  static Tables all;
  return all;
}

// The file lives as long as its mapping. Its room is taken at once: a full disk would be a signal
// amid a calculation.
void* map_file(std::size_t bytes) {
  const char* folder = std::getenv("TMPDIR");
  std::string path = std::string(folder && *folder ? folder : "/var/tmp") + "/echofuse-XXXXXX";
  const int file = ::mkostemp(path.data(), O_CLOEXEC);
  int error = file < 0 ? errno : 0;
  void* out = MAP_FAILED;
  if (file >= 0) {
    ::unlink(path.c_str());
    do error = ::posix_fallocate(file, 0, static_cast<off_t>(bytes));
    while (error == EINTR);
    if (error == 0) out = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (error == 0 && out == MAP_FAILED) error = errno;
    ::close(file);
  }
  if (out == MAP_FAILED)
    throw Error(ExitCode::disk, path + ": no room for a table of " + std::to_string(bytes >> 20) +
                                    " MiB beyond the memory: " + std::strerror(error));
  return out;
}

}  // namespace

void limit_table_memory(std::size_t bytes) {
  const std::lock_guard lock(tables().mutex);
  tables().limit = bytes;
}

std::size_t table_bytes_on_disk() {
  const std::lock_guard lock(tables().mutex);
  return tables().on_disk;
}

void* allocate_table(std::size_t bytes) {
  if (bytes < least_counted) return ::operator new(bytes);
  Tables& all = tables();
  const std::lock_guard lock(all.mutex);
  if (all.in_memory + bytes <= all.limit) {
    void* const out = ::operator new(bytes);
    all.in_memory += bytes;
    return out;
  }
  void* const out = map_file(bytes);
  all.files.insert(out);
  all.on_disk += bytes;
  return out;
}

void free_table(void* values, std::size_t bytes) noexcept {
  if (bytes < least_counted) return ::operator delete(values);
  Tables& all = tables();
  const std::lock_guard lock(all.mutex);
  if (all.files.erase(values) == 0) {
    all.in_memory -= bytes;
    return ::operator delete(values);
  }
  all.on_disk -= bytes;
  ::munmap(values, bytes);
}

}  // namespace echofuse::recon

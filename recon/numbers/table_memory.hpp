// SPDX-License-Identifier: MIT
// Memory of the values of large tables. What goes beyond a limit lies in files without a name, of
// which the system keeps in memory as much as it has room for: the calculation stays the same, bit
// by bit, and only waits for the disk. They are in TMPDIR (default: /var/tmp, as /tmp may itself be
// memory) and go with the process, however it ends.
//
// Threading: from any thread.
#pragma once
#include <cstddef>

namespace echofuse::recon {

// Of all tables of 1 MiB and more together; half of the machine's memory unless said.
void limit_table_memory(std::size_t bytes);
std::size_t table_bytes_on_disk();  // now

// allocate throws Error(disk) if the disk has no room.
void* allocate_table(std::size_t bytes);
void free_table(void* values, std::size_t bytes) noexcept;

template <class T>
struct TableAllocator {
  using value_type = T;
  TableAllocator() = default;
  template <class U>
  explicit TableAllocator(const TableAllocator<U>&) {}
  T* allocate(std::size_t n) { return static_cast<T*>(allocate_table(n * sizeof(T))); }
  void deallocate(T* values, std::size_t n) noexcept { free_table(values, n * sizeof(T)); }
  bool operator==(const TableAllocator&) const = default;
};

}  // namespace echofuse::recon

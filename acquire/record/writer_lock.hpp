// SPDX-License-Identifier: MIT
// Lock of a run's writer, which holds RUN-lock while it lives. Readers use it to distinguish a live
// run from a crashed one. A separate file, because closing any descriptor of the database itself
// would release SQLite's locks.
#pragma once
#include <string>

#include "drivers/util/lock.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::record {

struct WriterLock : Lock {
  explicit WriterLock(const std::string& run_path) : Lock(run_path + "-lock", 0) {}
  static bool someone_writes(const std::string& run_path) {
    return holder(real_path(run_path) + "-lock").has_value();
  }
};

}  // namespace echofuse::record

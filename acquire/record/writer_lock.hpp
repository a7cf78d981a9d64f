// SPDX-License-Identifier: MIT
// Lock file RUN-lock, which the process that writes a run holds until it ends. Readers use it to
// distinguish a live run from a crashed one. It is a separate file, because SQLite's locks would
// be released when any descriptor of the database file is closed.
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

// SPDX-License-Identifier: MIT
// Records and publishes imported runs.
#pragma once
#include <string>

#include "acquire/run/daemon.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/util/new_file.hpp"

namespace echofuse::acquire {

// Time at which the first slot begins.
struct RunStart {
  UtcTime utc{};
  std::string doubt;  // reason why the start time is uncertain; empty if --began is given
};

UtcTime modified(const std::string& path);

// Records an import in virtual time to the unpublished `file`. No sensor is required. Throws the
// errors of record_run(), also if the user interrupts the program.
void record_import(Config config, RunOptions options, port::Loop& loop, const NewFile& file);

// Publishes a complete run file. Returns a line about its contents. If no record has a valid
// sensor, publishes nothing and throws Error(failed); the message ends with `warnings`, one per
// line.
std::string publish_import(NewFile& file, std::string warnings = {});

}  // namespace echofuse::acquire

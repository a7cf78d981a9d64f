// SPDX-License-Identifier: MIT
// The `doctor` command: would a run with this configuration on this machine go well?
#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "acquire/config/config.hpp"
#include "acquire/doctor/machine.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::acquire {

struct DoctorOptions {
  std::optional<std::int64_t> count;  // slots of the run to come
  bool json = false;
  MachineRoots roots{};
};

// Prints one line for each check; without a configuration those of the machine only. The exit code
// of the first problem: device before disk; ok if there are none.
ExitCode examine(const std::optional<Config>& config, const DoctorOptions& options,
                 port::Loop& loop);

}  // namespace echofuse::acquire

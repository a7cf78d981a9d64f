// SPDX-License-Identifier: MIT
// The doctor's checks of the machine: what keeps a run from working before any device is opened.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/doctor/finding.hpp"
#include "drivers/inventory/inventory.hpp"

namespace echofuse::acquire {

// Where the kernel's and udev's files are; another root in tests.
struct MachineRoots {
  inventory::Roots devices;
  std::string proc = "/proc", run = "/run", etc = "/etc", lib = "/usr/lib";
};

// Attached devices and configured serial ports: may this user open them, are our udev rules there?
// A node that the configuration names is a problem, another one a warning.
std::vector<Finding> check_permissions(const std::optional<Config>& config,
                                       const MachineRoots& roots);
// ModemManager talks to every serial port that is not marked as none of its business.
Finding check_modem_manager(const std::optional<Config>& config, const MachineRoots& roots);
// The kernel's limit for all USB buffers together against the time tagger's ring.
Finding check_usb_memory(const std::optional<Config>& config, const MachineRoots& roots);

// What adjtimex(2) says of the clock.
struct ClockState {
  bool readable = false, synchronised = false;
  double maximal_error_s = 0;
};
ClockState read_clock();
Finding check_clock(const ClockState& clock);

}  // namespace echofuse::acquire

// SPDX-License-Identifier: MIT
// Lists attached devices and checks whether the configured ones deliver data, for `devices` and
// `doctor`.
#pragma once
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "acquire/devices/devices.hpp"

namespace echofuse::acquire {

struct Answer {
  Sensor sensor{};
  Devices::Status status;
  bool delivers = false;
  // State of the device, as returned by Devices::describe(). If another program uses the device,
  // the state is e.g. "in use by ...; record 7, 0.4 s ago: ok, 60 frames used, 0 lost".
  std::string text;
};

// Starts all configured devices that are free and waits until they deliver data, as `run` does.
// Devices in use by another program are not opened; their state is read from that program's run
// file. `command` is the name written into the device locks. Unless all devices are in use,
// `listen` is called while the devices send data to `sink`.
std::vector<Answer> ask(const Config& config, port::Loop& loop, const std::string& command,
                        SampleSink& sink, const std::function<void(const Devices&)>& listen = {});

// Implements `devices`: lists the attached devices, each with the lines to add to lab.toml, and
// then the state of the configured devices, if any. Returns ExitCode::device if a configured device
// delivers no data.
ExitCode list_devices(const std::optional<Config>& config, port::Loop& loop, bool json);

}  // namespace echofuse::acquire

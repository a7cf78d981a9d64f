// SPDX-License-Identifier: MIT
// Attached devices, and answers of the configured ones: printed by `devices`, checked by `doctor`.
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
  // For a device in use by another program: "in use by ...; record 7, 0.4 s ago: ok, 60 frames
  // used, 0 lost". Otherwise the text of Devices::describe().
  std::string text;
};

// Starts the free devices of the configuration as `command` and waits for them, like `run`. Devices
// in use are not opened; their state comes from the other program's run file. `listen` is called
// while the devices send into `sink`, unless none is free.
std::vector<Answer> ask(const Config& config, port::Loop& loop, const std::string& command,
                        SampleSink& sink, const std::function<void()>& listen = {});

// Implements `devices`: lists attached devices with the lines for lab.toml and, with a
// configuration, the answers of its devices. Returns the device code if one does not deliver.
ExitCode list_devices(const std::optional<Config>& config, port::Loop& loop, bool json);

}  // namespace echofuse::acquire

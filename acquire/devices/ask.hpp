// SPDX-License-Identifier: MIT
// Devices that are attached, and what the configured ones say when asked: `devices` prints it,
// `doctor` judges it.
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
  // "in use by ...; record 7, 0.4 s ago: ok, 60 frames used, 0 lost" of another program's device;
  // else as Devices::describe() has it.
  std::string text;
};

// Starts the configured devices that are free as `command` and waits for them as `run` does. Those
// that another program has are not touched: the run file that it writes tells of them. `listen`, if
// any, is called while the devices send into `sink`, unless none is free.
std::vector<Answer> ask(const Config& config, port::Loop& loop, const std::string& command,
                        SampleSink& sink, const std::function<void()>& listen = {});

// The `devices` command: what is attached, with the lines to write into lab.toml; then, given a
// configuration, what of it answers. Device code if one does not deliver.
ExitCode list_devices(const std::optional<Config>& config, port::Loop& loop, bool json);

}  // namespace echofuse::acquire

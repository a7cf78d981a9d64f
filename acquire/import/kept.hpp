// SPDX-License-Identifier: MIT
// A folder of `run --keep-raw` as a run: the daemon records anew from ports that hand out the kept
// bytes at the times at which they came (raw_tap.hpp), on a loop whose time jumps.
#pragma once
#include <string>
#include <vector>

#include "acquire/config/config.hpp"

namespace echofuse::acquire {

// Whether `run --keep-raw` made this folder.
bool is_kept(const std::string& folder);

// The configuration that the live run had, changed by `assignments`.
Config kept_config(const std::string& folder, std::vector<std::string> assignments);

// Makes the run `out` with the slots of the live one and says so in a line. Throws Error: files of
// the folder are missing or damaged (failed), or as record_run does.
std::string import_kept(Config config, const std::string& folder, const std::string& out);

}  // namespace echofuse::acquire

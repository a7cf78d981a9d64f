// SPDX-License-Identifier: MIT
// Output of the commands on run files, and the log's format.
#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/core/clock.hpp"

namespace spdlog {
class formatter;
}

namespace echofuse::acquire {

// `info`: what is in a run, live, closed or crashed.
// JSON (one object) or text. Throws Error if it is not a readable run.
std::string describe_run(const std::string& path, bool json);

// `annotate`: a note into a run, or another label into one that is being recorded.
// Exactly one of `note` and `label` is given. Returns what was done, a line:
//   monday.sqlite: label "person" from record 17 on
// Throws Error(failed) if a label is given and nobody is recording this run.
std::string annotate_run(const std::string& path, const std::optional<std::string>& note,
                         const std::optional<std::string>& label);

// Formatter of the log on stderr: erases the status line on a terminal, omits the time under
// systemd. Writes out whatever in a message would move the cursor.
std::unique_ptr<spdlog::formatter> log_format();

// `list`: the runs of a folder.
struct Catalogue {
  std::string text;
  std::string left_out;  // files that are no run, or that cannot be read: a line each, with why
};

// Lists all runs (*.sqlite) of the folder, oldest first: a line each and more on live ones, or one
// JSON array. A live run's object has `live`: last_index, age_s (since the last slot's end), label,
// and sensors: {NAME: {verdict, valid, used, lost}}. Values used and verdict are of the last
// record, lost of the whole run. Throws Error(failed) if the folder cannot be read.
Catalogue list_runs(const std::string& folder, const Clock& clock, bool json);

}  // namespace echofuse::acquire

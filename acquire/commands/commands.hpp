// SPDX-License-Identifier: MIT
// Output of the commands on run files, and log format.
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

// `info`: prints the contents of a run (live, closed or crashed), as JSON (one object) or text.
// Throws Error if it is not a readable run.
std::string describe_run(const std::string& path, bool json);

// `annotate`: adds a note to a run, or a new label to one in progress. Requires either `note` or
// `label`. Returns the result as a line:
//   monday.sqlite: label "person" from record 17 on
// Throws Error(failed) for a label if the run is not being recorded.
std::string annotate_run(const std::string& path, const std::optional<std::string>& note,
                         const std::optional<std::string>& label);

// Formatter of the log on stderr: erases the status line on a terminal, omits the time under
// systemd. Escapes characters in a message that would move the cursor.
std::unique_ptr<spdlog::formatter> log_format();

// `list`: lists the runs of a folder.
struct Catalogue {
  std::string text;
  std::string left_out;  // files that are not runs or cannot be read, one line each with the reason
};

// Lists all runs (*.sqlite) of the folder, oldest first: one line each with details of live ones,
// or a JSON array. A live run's object has `live`: last_index, age_s (since the end of the last
// slot), label, and sensors: {NAME: {verdict, valid, used, lost}}. `used` and `verdict` are of the
// last record, `lost` of the whole run. Throws Error(failed) if the folder cannot be read.
Catalogue list_runs(const std::string& folder, const Clock& clock, bool json);

}  // namespace echofuse::acquire

// SPDX-License-Identifier: MIT
// Commands that print or change run files, and the log format.
#pragma once
#include <memory>
#include <optional>
#include <string>

#include "drivers/core/clock.hpp"

namespace spdlog {
class formatter;
}

namespace echofuse::acquire {

// `info`: describes the contents of a run (live, closed or crashed) as one JSON object or as text.
// Throws Error if the file is not a readable run.
std::string describe_run(const std::string& path, bool json);

// `annotate`: adds a note to a run, or changes the label of a live run. Requires either `note` or
// `label`. Returns the result as one line, e.g. `monday.sqlite: label "person" from record 17 on`.
// Throws Error(failed) if a label is given but the run is not being recorded.
std::string annotate_run(const std::string& path, const std::optional<std::string>& note,
                         const std::optional<std::string>& label);

// Returns the formatter for log messages on stderr. On a terminal, it erases the status line first;
// under systemd, it omits the time. It escapes control characters in messages.
std::unique_ptr<spdlog::formatter> log_format();

// Output of `list`.
struct Catalogue {
  std::string text;
  std::string left_out;  // one line per file that is not a readable run, with the reason
};

// Lists all runs (*.sqlite) in the folder, oldest first. The text output has one line per run,
// followed by the details of live runs. The JSON is an array with one object per run. For a live
// run its member `live` contains last_index, age_s (time since the end of the last slot), label,
// and sensors: {NAME: {verdict, valid, used, lost}}. `verdict`, `valid` and `used` describe the
// last record; `lost` is the total for the whole run. Throws Error(failed) if the folder cannot be
// read.
Catalogue list_runs(const std::string& folder, const Clock& clock, bool json);

// `verdicts`: describes all verdicts (acquire/measurement/verdict.hpp) as a Markdown table or as a
// JSON array with one object per verdict.
std::string describe_verdicts(bool json);

}  // namespace echofuse::acquire

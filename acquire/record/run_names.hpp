// SPDX-License-Identifier: MIT
// Names of runs on the command line.
#pragma once
#include <string>

namespace echofuse::record {

// Returns NAME, with .sqlite added if missing: "gain1.5" has no extension of a run.
std::string with_run_extension(const std::string& name);
// Returns an existing run, by file name or by the name given to --out.
std::string old_run(const std::string& name);
// Returns the name of a run file from --out, with its time fields replaced by the current UTC, so
// that a service uses a new name for each run. Fields: strftime's %Y %m %d %H %M %S %y %j %F %T,
// and %%. Throws Error(usage) for any other %, among others.
std::string new_run(const std::string& out);
// Returns FOLDER/DATE-NNN.sqlite with the current date (UTC) and NNN one above the highest existing
// number.
std::string next_run(const std::string& folder);
// Returns the name of the next run of `run --every`: new_run(out) if it has time fields and does
// not exist, otherwise NAME-NNN.sqlite with NNN one above the highest existing number.
std::string next_of(const std::string& out);

}  // namespace echofuse::record

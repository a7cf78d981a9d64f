// SPDX-License-Identifier: MIT
// Names of run files given on the command line.
#pragma once
#include <string>

namespace echofuse::record {

// Appends .sqlite unless the name already ends in .sqlite. For example, "gain1.5" becomes
// "gain1.5.sqlite".
std::string with_run_extension(const std::string& name);
// Returns the file name of an existing run, which may be given without its extension.
std::string old_run(const std::string& name);
// Returns the absolute path of a new run file for --out. Time fields are replaced by the current
// UTC, so that a service gets a new name for each run. The allowed fields are %Y %m %d %H %M %S %y
// %j %F %T and %%, with the same meanings as in strftime. Throws Error(usage) if the name is empty
// or contains another field.
std::string new_run(const std::string& out);
// Returns FOLDER/DATE-NNN.sqlite. DATE is the current date (UTC), and NNN is one above the highest
// existing number.
std::string next_run(const std::string& folder);
// Returns the path of the next file of `run --every`. It is new_run(out) if `out` has time fields
// and the file does not exist, otherwise NAME-NNN.sqlite, with NNN one above the highest existing
// number.
std::string next_of(const std::string& out);

}  // namespace echofuse::record

// SPDX-License-Identifier: MIT
// Names of runs in commands.
#pragma once
#include <string>

namespace echofuse::record {

// NAME, or NAME.sqlite where it does not end so: "gain1.5" has no extension of a run.
std::string with_run_extension(const std::string& name);
// A run that is there, by its file or by the name that --out gave it.
std::string old_run(const std::string& name);
// Name of a run file by --out, with its fields of the time filled in: now, UTC, so that a service
// names each run anew. Fields: strftime's %Y %m %d %H %M %S %y %j %F %T, and %%. Throws
// Error(usage), also for any other %.
std::string new_run(const std::string& out);
// FOLDER/DATE-NNN.sqlite, DATE of now (UTC), NNN one above the highest there.
std::string next_run(const std::string& folder);
// Name of the next run of `run --every`: new_run(out) if it has fields of the time and is free,
// else NAME-NNN.sqlite, NNN one above the highest there.
std::string next_of(const std::string& out);

}  // namespace echofuse::record

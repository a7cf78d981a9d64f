// SPDX-License-Identifier: MIT
// How commands name runs.
#pragma once
#include <string>

namespace echofuse::record {

// A name without an extension is that of NAME.sqlite.
std::string with_run_extension(const std::string& name);
// A run that is there, by its file or by the name that --out gave it.
std::string old_run(const std::string& name);
// --out as a file: strftime's fields are those of now (UTC), so that a service names each run anew.
// Throws Error(usage).
std::string new_run(const std::string& out);
// FOLDER/DATE-NNN.sqlite, DATE of now (UTC), NNN one above the highest there. Throws Error(disk) if
// the folder is not there.
std::string next_run(const std::string& folder);

}  // namespace echofuse::record

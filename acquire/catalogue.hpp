// SPDX-License-Identifier: MIT
// The runs of a folder.
#pragma once
#include <string>

namespace echofuse::acquire {

struct Catalogue {
  std::string text;
  std::string left_out;  // files that are no run, or that cannot be read: a line each, with why
};

// All runs (*.sqlite) of the folder, oldest first: one line for each, or one JSON array. Throws
// Error(failed) if the folder cannot be read.
Catalogue list_runs(const std::string& folder, bool json);

}  // namespace echofuse::acquire

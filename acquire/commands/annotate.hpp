// SPDX-License-Identifier: MIT
// The `annotate` command: a note into a run, or another label into one that is being recorded.
#pragma once
#include <optional>
#include <string>

namespace echofuse::acquire {

// Exactly one of `note` and `label` is given. Returns what was done, a line:
//   monday.sqlite: label "person" from record 17 on
// Throws Error(failed) if a label is given and nobody is recording this run.
std::string annotate_run(const std::string& path, const std::optional<std::string>& note,
                         const std::optional<std::string>& label);

}  // namespace echofuse::acquire

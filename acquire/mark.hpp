// SPDX-License-Identifier: MIT
// The `mark` command: a remark or another label into a run that is being recorded.
#pragma once
#include <optional>
#include <string>

namespace echofuse::acquire {

// Exactly one of `remark` and `label` is given. Returns what was done, a line:
//   monday.sqlite: label "person" from record 17 on
// Throws Error(failed) if nobody is recording this run.
std::string mark_run(const std::string& path, const std::optional<std::string>& remark,
                     const std::optional<std::string>& label);

}  // namespace echofuse::acquire

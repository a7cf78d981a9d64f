// SPDX-License-Identifier: MIT
// The `replay` command: recorded byte streams, as `run --keep-raw` keeps them, through the parsers
// that live data go through. Several files are connections of the same device, one after the other.
#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace echofuse::acquire {

// Counts, named as the counters of a run, as JSON (one object) or text for people. Throws Error if
// a file cannot be read.
struct Replayed {
  std::string text;
  bool any = false;  // there was a tag or a whole frame: if not, it is of another device
};
// Of recordings of the radar's data port:
Replayed replay_radar(const std::vector<std::string>& paths, bool json);
// Of blocks of the bridge protocol:
Replayed replay_tdc(const std::vector<std::string>& paths, bool json);
Replayed replay_depth(const std::vector<std::string>& paths, bool json);

// "file" and the counts, in either form; `samples`: the name of the count of tags or frames.
Replayed replay_result(const std::vector<std::string>& paths, const nlohmann::ordered_json& counts,
                       const char* samples, bool json);

}  // namespace echofuse::acquire

// SPDX-License-Identifier: MIT
// Pictures of a run that parts of a reconstruction have made, in OUT/part-K-of-N. Maps take
// microseconds and pictures milliseconds, so it is these that are worth sharing.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "drivers/core/job_part.hpp"

namespace echofuse::recon {

// Of the run that takes the parts.
class MapParts {
 public:
  // `what`: a text of all that pictures depend on, asked for if there are parts. Throws
  // Error(usage) for a part of something else.
  MapParts(std::string folder, const std::function<std::string()>& what);
  // Moves a file of this name, which a part has made, into the folder; false if none has.
  bool take(const std::string& name) const;
  void remove() const;  // what is left of the parts

 private:
  std::string folder_;
  std::vector<std::string> parts_;
};

// The folder of a part that is being made, empty; a process that died may have left one.
std::string begin_map_part(const std::string& folder, const JobPart& part, const std::string& what);
// It is whole. Throws Error(disk).
void end_map_part(const std::string& folder, const JobPart& part);

}  // namespace echofuse::recon

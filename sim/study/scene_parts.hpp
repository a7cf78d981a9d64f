// SPDX-License-Identifier: MIT
// A study has rows of numbers, one a scene, and its scenes are shared between processes. A part
// writes FOLDER/NAME-part-K-of-N.csv: comments with the settings, then "scene,number,number,...".
#pragma once
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "drivers/program/job_part.hpp"

namespace echofuse::sim {

struct SceneParts {
  std::string folder = {};           // folder of the study; if empty, no parts are looked for
  std::string settings = {};         // lines: all that a row depends on but for the scene's number
  std::optional<JobPart> part = {};  // if set, only its scenes
};

using SceneRow = std::vector<double>;

// Computes work(i) of each scene i that no part in the folder has, on all processors. Returns the
// rows of all scenes in their order; for a part writes its file and returns nothing. Throws
// Error(interrupted), Error(config) for a part of other settings or another version, Error(failed)
// for a damaged part, and Error(disk).
std::vector<SceneRow> rows_of_scenes(const SceneParts& parts, const std::string& name,
                                     const std::string& title, std::int64_t scenes, bool quiet,
                                     const std::function<SceneRow(std::size_t)>& work);

}  // namespace echofuse::sim

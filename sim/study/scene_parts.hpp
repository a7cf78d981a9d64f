// SPDX-License-Identifier: MIT
// Rows of numbers, one a scene, of a study whose scenes are shared between processes. A part writes
// FOLDER/NAME-part-K-of-N.csv: comments with the settings, then "scene,number,number,...".
#pragma once
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "drivers/core/job_part.hpp"

namespace echofuse::sim {

struct SceneParts {
  std::string folder = {};           // of the study; empty: no parts are looked for
  std::string settings = {};         // lines: all that a row depends on but for the scene's number
  std::optional<JobPart> part = {};  // only its scenes
};

using SceneRow = std::vector<double>;

// work(i) of each scene i that no part in the folder has, on all processors; the rows of all scenes
// in their order. Of a part: its file is written, and nothing is returned. Throws Error:
// interrupted; config for a part of other settings or another version; failed for a damaged one;
// disk.
std::vector<SceneRow> rows_of_scenes(const SceneParts& parts, const std::string& name,
                                     const std::string& title, std::int64_t scenes, bool quiet,
                                     const std::function<SceneRow(std::size_t)>& work);

}  // namespace echofuse::sim

// SPDX-License-Identifier: MIT
// A study has rows of numbers, one a scene.
#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace echofuse::sim {

using SceneRow = std::vector<double>;

// Computes work(i) of each scene i on all processors, and returns the rows in the scenes' order.
// Throws Error(interrupted).
std::vector<SceneRow> rows_of_scenes(const std::string& title, std::int64_t scenes, bool quiet,
                                     const std::function<SceneRow(std::size_t)>& work);

}  // namespace echofuse::sim

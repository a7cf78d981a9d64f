// SPDX-License-Identifier: MIT
// Colours and names of models in the charts of studies: as in a report.
#pragma once
#include <array>
#include <string>

#include "drivers/chart/style.hpp"

namespace echofuse::recon {

// What is made of one sensor has the sensor's colour, the factorised model that of both sensors, a
// network as the paper's that one. Each colour once; the next best is free, or it is grey.
class ModelColours {
 public:
  int of(const std::string& model) {
    const int wanted = model.ends_with(":spd")           ? chart::of_spd
                       : model.ends_with(":radar")       ? chart::of_radar
                       : model.find("mlp") == 0          ? chart::of_paper
                       : model.starts_with("factorised") ? chart::of_both
                       : model == "nearest"              ? chart::grey
                                                         : chart::of_camera;
    for (const int colour : {wanted, chart::of_camera, chart::grey, chart::of_radar, chart::of_spd,
                             chart::of_paper, chart::of_both})
      if (!used_[static_cast<std::size_t>(colour)]) {
        used_[static_cast<std::size_t>(colour)] = true;
        return colour;
      }
    return chart::grey;
  }

 private:
  std::array<bool, chart::colour_count> used_{};
};

// "mlp-512-256, SPD alone" of "mlp-512-256:spd".
inline std::string name_in_charts(const std::string& model) {
  const auto colon = model.find(':');
  if (colon == std::string::npos) return model;
  const std::string inputs = model.substr(colon + 1);
  return model.substr(0, colon) + (inputs == "spd"             ? ", SPD alone"
                                   : inputs == "radar"         ? ", radar alone"
                                   : inputs == "fused-profile" ? ", one antenna"
                                                               : ", " + inputs);
}

}  // namespace echofuse::recon

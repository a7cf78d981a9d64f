// SPDX-License-Identifier: MIT
// This is what the pages of the studies have in common: colours and names of models, as in a
// report.
#pragma once
#include <set>
#include <string>

#include "recon/page/page.hpp"
#include "recon/study/study.hpp"

namespace echofuse::recon {

// What is made of one sensor has the sensor's colour, the factorised model that of both sensors, a
// network as the paper's that one.
inline std::string colour_of_model(const std::string& model) {
  return model.ends_with(":spd")           ? "spd"
         : model.ends_with(":radar")       ? "radar"
         : model.starts_with("mlp")        ? "papers"
         : model.starts_with("factorised") ? "both"
         : model == "nearest"              ? "grey"
                                           : "depth";
}

// In a chart of few lines each colour is there once: the next best that is free, or grey.
class ModelColours {
 public:
  std::string of(const std::string& model) {
    for (const std::string& colour :
         {colour_of_model(model), std::string("depth"), std::string("grey"), std::string("radar"),
          std::string("spd"), std::string("papers"), std::string("both")})
      if (used_.insert(colour).second) return colour;
    return "grey";
  }

 private:
  std::set<std::string> used_;
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

// The ends of a bar about a mean; null without a spread.
inline Json bar_of(double mean, double spread) {
  if (!(spread > 0)) return nullptr;
  return {short_number(mean - spread), short_number(mean + spread)};
}

}  // namespace echofuse::recon

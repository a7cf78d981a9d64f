// SPDX-License-Identifier: MIT
// What a study of stability found: means over the seeds, and where each model fails.
#pragma once
#include <array>
#include <string>
#include <vector>

#include "recon/study/stability.hpp"

namespace echofuse::recon {

// A model at one value. NaN: undefined, or there is no map.
struct StabilityPoint {
  std::array<double, metric_count> mean{}, spread{};  // spread: standard deviation over the seeds
  bool fails = false;                                 // stability.hpp
  bool halved = false;                                // its IoU is below half of that at the base
};

struct StabilityCurve {
  std::string name;                    // "CANDIDATE" or "CANDIDATE:INPUTS"
  std::vector<StabilityPoint> points;  // one a value of the axis
  // The first values with that, going from the base to each end; that of the base alone if it
  // begins there.
  std::vector<std::string> fails_at, halved_at;
  double worst = 0;  // least IoU, as a share of that at the base; NaN if it fails there already
};

struct StabilityResult {
  StabilityAxis axis;
  std::vector<StabilityCurve> curves;     // of the models, in their order
  std::vector<StabilityCurve> baselines;  // empty room and mean map
};

// Sorted by what breaks the first model most. Rows of other axes and models are left out.
std::vector<StabilityResult> summarise_stability(const StabilityOptions& options,
                                                 const std::vector<Measurement>& rows);

// Writes OUT/stability.csv with all rows, OUT/stability.html and a chart for each axis,
// OUT/KIND-AXIS.svg. Throws Error(disk).
void write_stability(const StabilityOptions& options, const std::vector<Measurement>& rows,
                     const std::vector<StabilityResult>& results);
std::string to_text(const std::vector<StabilityResult>& results);

}  // namespace echofuse::recon

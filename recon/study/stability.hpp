// SPDX-License-Identifier: MIT
// This is where models fail: each of a list under conditions from easy to broken, trained under the
// condition itself (matched) or at the base condition only (shifted).
//
// A model *fails* at a value if its map is no better than no map: its hard SSIM is not above that
// of the empty room, or its IoU not above that of empty room and mean map, with the same records
// and by more than the spread over seeds; or if it gives no map at all (a sensor is missing, the
// training is refused or diverges). IoU alone would be too kind: the empty room scores 0, and a
// body in the wrong place a little more. Where nobody is there, IoU is undefined, and a model fails
// that shows somebody.
#pragma once
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "recon/metrics/metrics.hpp"
#include "recon/study/stability_axes.hpp"
#include "recon/study/study_file.hpp"

namespace echofuse::recon {

struct StabilityOptions : StudyOptions {  // each seed makes its own records, and its own models
  std::string sim;                        // the simulator (simulate.hpp)
  std::vector<std::string> set;           // KEY=VALUE, of its base condition
  BaseCondition base = {};                // of that simulator
  bool quick = false;
  std::vector<std::string> models;            // as StudyModel has them; none: those of the study
  std::vector<std::string> axes;              // ids; none: all
  std::size_t records = 0, test_records = 0;  // 0: those of the study
};

inline constexpr std::array stability_metrics = {
    metric_iou,   metric_ssim_fg,     metric_ssim_hard, metric_lateral_m,
    metric_ghost, metric_depth_mae_m, metric_rmse_m,    metric_left_right};
// The models that every other must beat; they look at no sensor.
inline const std::vector<std::string> constant_models = {"empty", "mean"};
// If the study has it, this is the baseline that draws a body where empty room and mean map do not.
inline constexpr const char* nearest_baseline = "nearest";

// With defaults filled in, and the base condition as the simulator tells it. Throws Error(usage)
// for models and axes that are not known, and as Simulator.
StabilityOptions complete(StabilityOptions options);
std::vector<StabilityAxis> axes_of(const StabilityOptions& options);

// Measures what OUT/stability.csv does not have yet: all that it has then, by the id of its axis
// ("base": the base value of every axis); inputs of a constant model: "-"; NaN also where there is
// no map. Of a part: nothing. Throws Error(config) if what is there was measured otherwise, and as
// StudyFile.
std::vector<Measurement> study_stability(const StabilityOptions& options);

// A model at one value. NaN: undefined, or there is no map.
struct StabilityPoint {
  std::array<double, metric_count> mean{}, spread{};  // spread: standard deviation over the seeds
  bool fails = false;                                 // as above
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

// OUT/stability.html. Throws Error(disk).
void write_stability_page(const StabilityOptions& options,
                          const std::vector<StabilityResult>& results);
std::string to_text(const std::vector<StabilityResult>& results);

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "recon/study/stability.hpp"
#include "recon/study/study.hpp"

namespace echofuse::recon {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

struct Moments {
  double mean = nan, spread = 0;
};

// NaN if any is: a model that gives no map with one of the seeds is not to be relied on.
Moments moments(const std::vector<double>& values) {
  if (values.empty()) return {};
  const auto n = static_cast<double>(values.size());
  double sum = 0, squares = 0;
  for (const double v : values) sum += v;
  for (const double v : values) squares += (v - sum / n) * (v - sum / n);
  return {sum / n, n > 1 ? std::sqrt(squares / (n - 1)) : 0};
}

// All rows of one model at one value, by seed.
using Seeds = std::map<std::size_t, Measurement>;

Seeds seeds_at(const std::vector<Measurement>& rows, const StabilityAxis& axis,
               const AxisValue& value, const std::string& model, const std::string& inputs) {
  const bool base = value.world.base();
  const std::string id = base ? "base" : axis.id(), label = base ? "base" : value.label;
  Seeds out;
  for (const Measurement& r : rows)
    if (std::tie(r.axis, r.value, r.model, r.inputs) == std::tie(id, label, model, inputs))
      out[r.seed] = r;
  return out;
}

// By how much a model is better than the best baseline with the same seed; those of which the
// score is undefined (nobody there) do not count. One number a seed, or none.
std::vector<double> advantage(const Seeds& model, const std::vector<const Seeds*>& baselines,
                              Metric metric) {
  std::vector<double> out;
  for (const auto& [seed, row] : model) {
    double best = nan;
    for (const Seeds* other : baselines)
      if (const auto found = other->find(seed); found != other->end())
        best = std::fmax(best, found->second.metric(metric_names[metric]));
    if (!std::isnan(best)) out.push_back(row.metric(metric_names[metric]) - best);
  }
  return out;
}

// Written so that NaN, no map, fails.
bool fails(const Seeds& model, const Seeds& empty, const Seeds& mean) {
  const auto iou = advantage(model, {&empty, &mean}, metric_iou);
  const Moments by_iou = moments(iou),
                by_ssim = moments(advantage(model, {&empty}, metric_ssim_hard));
  if (iou.empty()) return !(by_ssim.mean + by_ssim.spread >= 0);  // somebody is shown
  return !(by_iou.mean > by_iou.spread && by_ssim.mean > by_ssim.spread);
}

StabilityPoint point_of(const Seeds& seeds) {
  StabilityPoint point;
  point.mean.fill(nan), point.spread.fill(nan);
  for (const Metric m : stability_metrics) {
    std::vector<double> values;
    for (const auto& [seed, row] : seeds) values.push_back(row.metric(metric_names[m]));
    const Moments found = moments(values);
    point.mean[m] = found.mean, point.spread[m] = found.spread;
  }
  return point;
}

// The first values with this property on the ways from the base to both ends.
std::vector<std::string> first_on_the_way(const StabilityAxis& axis,
                                          const std::vector<StabilityPoint>& points,
                                          bool StabilityPoint::*property) {
  const std::size_t base = axis.base();
  if (points[base].*property) return {axis.values[base].label};
  std::vector<std::string> out;
  for (const std::size_t step : {std::size_t(-1), std::size_t{1}})  // down past 0 it wraps round
    for (std::size_t i = base + step; i < points.size(); i += step)
      if (points[i].*property) {
        out.push_back(axis.values[i].label);
        break;
      }
  return out;
}

// IoU as a share of the base's: 0 without a map, NaN where nobody is there to be found.
double share(const StabilityPoint& point, const StabilityPoint& base, const StabilityPoint& empty) {
  if (std::isnan(empty.mean[metric_iou])) return nan;
  return std::isnan(point.mean[metric_ssim_hard]) ? 0
                                                  : point.mean[metric_iou] / base.mean[metric_iou];
}

StabilityCurve curve_of(const StabilityAxis& axis, const std::vector<Measurement>& rows,
                        const std::string& name, const std::string& model,
                        const std::string& inputs) {
  StabilityCurve curve{name, {}, {}, {}, nan};
  for (const AxisValue& value : axis.values) {
    const Seeds seeds = seeds_at(rows, axis, value, model, inputs);
    curve.points.emplace_back(point_of(seeds)).fails =
        fails(seeds, seeds_at(rows, axis, value, constant_models[0], "-"),
              seeds_at(rows, axis, value, constant_models[1], "-"));
  }
  const StabilityPoint base = curve.points[axis.base()];
  for (std::size_t i = 0; i < curve.points.size(); ++i) {
    StabilityPoint& point = curve.points[i];
    const double now =
        share(point, base, point_of(seeds_at(rows, axis, axis.values[i], constant_models[0], "-")));
    point.halved = now < 0.5;
    if (!base.fails) curve.worst = std::fmin(curve.worst, now);
  }
  curve.fails_at = first_on_the_way(axis, curve.points, &StabilityPoint::fails);
  if (!base.fails) curve.halved_at = first_on_the_way(axis, curve.points, &StabilityPoint::halved);
  return curve;
}

double first_worst(const StabilityResult& result) {
  const double worst = result.curves.empty() ? nan : result.curves.front().worst;
  return std::isnan(worst) ? 1 : worst;
}

}  // namespace

std::vector<StabilityResult> summarise_stability(const StabilityOptions& options,
                                                 const std::vector<Measurement>& rows) {
  std::vector<StabilityResult> results;
  for (const StabilityAxis& axis : axes_of(options)) {
    StabilityResult result{axis, {}, {}};
    for (const auto& name : constant_models)
      result.baselines.push_back(curve_of(axis, rows, name, name, "-"));
    for (const auto& name : options.models) {
      const StudyModel model(name);
      result.curves.push_back(curve_of(axis, rows, name, model.candidate, model.inputs));
    }
    results.push_back(std::move(result));
  }
  std::stable_sort(results.begin(), results.end(),
                   [](const auto& a, const auto& b) { return first_worst(a) < first_worst(b); });
  return results;
}

}  // namespace echofuse::recon

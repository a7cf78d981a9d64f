// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "acquire/measurement/depth_map.hpp"
#include "drivers/util/format.hpp"
#include "recon/data/late_truth.hpp"
#include "recon/metrics/mirrored_camera.hpp"
#include "recon/score/evaluate.hpp"

namespace echofuse::recon {
namespace {

using nlohmann::json;

std::string to_text(const TwoPeopleCounts& two) {
  if (two.records == 0) return "";
  return format("%zu of %zu records with two people are flagged as out of distribution",
                two.flagged, two.records);
}

json number(double value) { return std::isnan(value) ? json(nullptr) : json(value); }

json metrics_json(const Summaries& metrics) {
  json out = json::object();
  for (std::size_t m = 0; m < metric_count; ++m)
    out[metric_names[m]] = {{"mean", number(metrics[m].mean)},
                            {"se", number(metrics[m].se)},
                            {"maps", metrics[m].maps}};
  return out;
}

}  // namespace

json to_json(const Evaluation& e) {
  json baselines = json::object();
  for (const auto& row : e.baselines) baselines[row.name] = metrics_json(row.metrics);
  std::size_t fallback_records = 0;
  for (const auto& [note, records] : e.fallbacks) fallback_records += records;
  json out = {{"model", e.model},
              {"inputs", name_of(e.inputs)},
              {"records", e.records},
              {"left_out", e.left_out},
              {"trained_on", e.trained_on},
              {"twice", e.twice},
              {"fallback_records", fallback_records},
              {"fallbacks", e.fallbacks},
              {"note", e.scoring.note},
              {"foreground_depth_m", e.scoring.scene.foreground_depth_m},
              {"antennas", e.antennas},
              {"response", e.response},
              {"ranges", e.ranges},
              {"metrics", metrics_json(e.metrics)},
              {"trivial", baselines},
              {"cost",
               {{"multiply_adds", e.cost.cost.multiply_adds},
                {"parameters", e.cost.cost.parameters},
                {"infer_us_median", e.cost.infer_us_median},
                {"infer_us_p99", e.cost.infer_us_p99},
                {"infer_us_batch", e.cost.infer_us_batch},
                {"train_s", e.cost.train_s},
                {"model_bytes", e.cost.model_bytes}}}};
  if (!e.doubtful.empty())
    out["doubtful"] = {{"records", e.doubtful}, {"metrics", metrics_json(e.with_doubtful)}};
  if (const TwoPeopleCounts& two = e.two_people; two.records > 0)
    out["two_people"] = {
        {"records", two.records}, {"flagged", two.flagged}, {"text", to_text(two)}};
  if (e.domain_shift.tested())
    out["domain_shift"] = {{"p", e.domain_shift.p},
                           {"records", e.domain_shift.records},
                           {"judged", e.domain_shift.assessed},
                           {"flagged", e.domain_shift.flagged},
                           {"found", e.domain_shift.found()},
                           {"interval_factor", e.domain_shift.interval_factor},
                           {"text", e.tested + e.domain_shift.text()}};
  out["notes"] = notes(e);
  out["calibrated"] = e.calibration.has_value();
  if (e.calibration)
    out["calibration"] = {{"within_lateral_interval_90", number(e.calibration->within_90)},
                          {"lateral_interval_90_m", number(e.calibration->lateral_interval_90_m)},
                          {"flagged", e.calibration->flagged},
                          {"pixel_error_m", e.calibration->error_m},
                          {"pixel_deviation_m", e.calibration->deviation_m}};
  return out;
}

json to_json(const std::vector<ScoredRow>& rows, const std::vector<ScoredRow>& baselines,
             std::size_t records, const std::string& note) {
  json all = json::array(), trivial = json::object();
  for (const ScoredRow& row : rows)
    all.push_back({{"model", row.name}, {"metrics", metrics_json(row.metrics)}});
  for (const ScoredRow& row : baselines) trivial[row.name] = metrics_json(row.metrics);
  json out = all.at(0);
  out.update({{"records", records}, {"note", note}, {"rows", all}, {"trivial", trivial}});
  return out;
}

std::string to_table(const std::vector<ScoredRow>& rows) {
  std::string out = format("%-12s", "metric");
  for (const auto& row : rows) out += format(" %15s", row.name.c_str());
  out += '\n';
  for (std::size_t m = 0; m < metric_count; ++m) {
    out += format("%-12s", metric_names[m]);
    for (const auto& row : rows) out += format(" %15s", formatted(row.metrics[m], " +-").c_str());
    if (m == metric_depth_mae_m) {
      out += format("\n%-12s", "  over maps");
      for (const auto& row : rows) out += format(" %15zu", row.metrics[m].maps);
    }
    out += '\n';
  }
  return out;
}

std::string to_text(const std::optional<UncertaintyCalibration>& c) {
  if (!c) return std::string("not calibrated: ") + reason_not_calibrated + "\n";
  const std::string lateral =
      std::isnan(c->within_90)
          ? ""
          : format(
                "%.1f %% of the bodies are within their 90 %% interval, which is +- %.1f cm on "
                "average; ",
                100 * c->within_90, 100 * c->lateral_interval_90_m);
  return lateral + format(
                       "%.2f %% of the records are out of distribution; rms error per pixel "
                       "%.2f m, estimated %.2f m\n",
                       100 * c->flagged, c->error_m, c->deviation_m);
}

std::string faults_of_truth(const Dataset& data) {
  std::string out = late_truth(data);
  const std::string mirrored = mirrored_camera(data);
  if (!out.empty() && !mirrored.empty()) out += '\n';
  return out + mirrored;
}

std::string mirrored_truth(const Summaries& metrics) {
  constexpr std::size_t min_maps = 10;
  // mirrored_truth() returns a warning if the fraction of bodies predicted on the correct side is
  // below this limit. A random choice of the side would yield 0.5.
  constexpr double max_share = 0.1;
  const Summary& right = metrics[metric_left_right];
  if (right.maps < min_maps || !(right.mean < max_share)) return {};
  return format(
      "the predicted side is wrong for %.0f of %zu bodies: the camera image is mirrored in this "
      "run or was mirrored in training; flip the depth maps of this run left to right",
      (1 - right.mean) * static_cast<double>(right.maps), right.maps);
}

std::string notes(const Evaluation& e) {
  std::string out = e.domain_shift.tested() ? e.tested + e.domain_shift.text() + '\n' : "";
  for (const std::string& fault : {e.truth, mirrored_truth(e.metrics)})
    if (!fault.empty()) out += fault + '\n';
  if (!e.scoring.note.empty()) out += e.scoring.note + '\n';
  if (!e.scoring.scene.has_body()) out += std::string(no_body) + '\n';
  for (const std::string& remark : {e.antennas, e.response, e.ranges, to_text(e.two_people)})
    if (!remark.empty()) out += remark + '\n';
  for (const auto& [note, records] : e.fallbacks)
    out += format("%zu records: %s\n", records, note.c_str());
  if (e.left_out > 0) {
    out += format("%zu records with a depth map left out: ", e.left_out);
    for (std::string separator; const auto& [why, count] : e.faults)
      out += separator + format("%s %zu", why.c_str(), count), separator = ", ";
    out += '\n';
  }
  if (e.twice > 0) out += format("records left out: %s %zu\n", duplicate_in_run, e.twice);
  if (e.trained_on > 0)
    out += format("%zu of %zu records are copies of training records%s\n", e.trained_on, e.of,
                  e.records + e.trained_on <= e.of ? " and are left out" : " and are scored");
  if (e.doubtful.empty()) return out;
  std::string reasons;
  for (const auto& [reason, records] : e.doubtful)
    reasons += format("%s%s %zu", reasons.empty() ? "" : ", ", reason.c_str(), records);
  std::string differ;
  for (const auto& [m, name] : {std::pair{metric_iou, "IoU"}, {metric_lateral_m, "lateral_m"}})
    if (const std::string with = formatted(e.with_doubtful[m], " +-"),
        own = formatted(e.metrics[m], " +-");
        with != own)
      differ += format("%s %s %s instead of %s", differ.empty() ? "; including them:" : ",", name,
                       with.c_str(), own.c_str());
  out += "doubtful records left out: " + reasons + differ + '\n';
  return out;
}

std::string to_text(const Evaluation& e) {
  std::vector<ScoredRow> rows = {{e.model + " " + name_of(e.inputs), e.metrics}};
  rows.insert(rows.end(), e.baselines.begin(), e.baselines.end());
  return format("%zu records; mean +- standard error over maps\n", e.records) + notes(e) +
         to_table(rows) +
         format(
             "%zu multiply-adds per map, %zu parameters, %.0f us per map (median; p99 %.0f) on one "
             "thread\n",
             e.cost.cost.multiply_adds, e.cost.cost.parameters, e.cost.infer_us_median,
             e.cost.infer_us_p99) +
         format("trained in %.1f s, model file %.1f MB\n", e.cost.train_s,
                static_cast<double>(e.cost.model_bytes) / 1e6) +
         to_text(e.calibration);
}

}  // namespace echofuse::recon

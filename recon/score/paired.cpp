// SPDX-License-Identifier: MIT
#include "recon/score/paired.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "drivers/core/random.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/data/files.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

MeanInterval interval_of(std::span<const double> values, Metric metric) {
  constexpr std::size_t resamples = 2000, min_records = 5;
  MeanInterval out{values.size()};
  if (values.empty()) return out;
  out.mean = mean_of(values);
  Rng rng = make_rng(1, static_cast<std::uint64_t>(metric));
  std::vector<float> means;
  for (std::size_t k = 0; k < resamples; ++k) {
    double sum = 0;
    for (const std::size_t i : resampled_blocks(values.size(), values.size(), rng))
      sum += values[i];
    means.push_back(static_cast<float>(sum / static_cast<double>(values.size())));
  }
  if (values.size() >= min_records)
    out.low = double{quantile(means, 0.025)}, out.high = double{quantile(means, 0.975)};
  return out;
}

MapScores mean_scores(const std::vector<MapScores>& all) {
  MapScores out;
  std::ranges::transform(summarise(all), out.begin(), &Summary::mean);
  return out;
}

}  // namespace

MeanInterval mean_interval(const std::vector<MapScores>& scores, Metric metric) {
  std::vector<double> values;
  for (const MapScores& one : scores)
    if (!std::isnan(one[metric])) values.push_back(one[metric]);
  return interval_of(values, metric);
}

double gain(Metric metric, double first, double second) {
  const bool less = metric == metric_lateral_m || metric == metric_depth_mae_m ||
                    metric == metric_rmse_m || metric == metric_ghost;
  return less ? first - second : second - first;
}

std::vector<PairedDifference> paired_differences(const std::vector<MapScores>& first,
                                                 const std::vector<MapScores>& second) {
  std::vector<PairedDifference> out;
  for (const Metric m : {metric_iou, metric_lateral_m, metric_depth_mae_m, metric_ssim_fg,
                         metric_ssim_hard, metric_rmse_m, metric_ghost}) {
    std::vector<double> differences;
    double of_first = 0, of_second = 0;
    for (std::size_t i = 0; i < first.size(); ++i) {
      if (std::isnan(first[i][m]) || std::isnan(second[i][m])) continue;
      of_first += first[i][m], of_second += second[i][m];
      differences.push_back(gain(m, first[i][m], second[i][m]));
    }
    if (differences.empty()) continue;
    const auto n = static_cast<double>(differences.size());
    out.push_back({interval_of(differences, m), m, of_first / n, of_second / n});
  }
  return out;
}

nlohmann::json to_json(const std::vector<PairedDifference>& differences) {
  auto out = nlohmann::json::object();
  for (const PairedDifference& d : differences)
    out[metric_names[d.metric]] = {{"records", d.records}, {"first", d.first}, {"second", d.second},
                                   {"mean", d.mean},       {"low", d.low},     {"high", d.high}};
  return out;
}

std::vector<NamedScores> read_scores(const std::string& path) {
  std::istringstream text(read_text(path));
  std::string line;
  std::getline(text, line);
  const auto head = csv_fields(line);
  const auto column = [&](const char* name) {
    return static_cast<std::size_t>(std::ranges::find(head, name) - head.begin());
  };
  const std::size_t record = column("record"), name = column("name");
  std::array<std::size_t, metric_count> of_metric{};
  for (std::size_t m = 0; m < metric_count; ++m) of_metric[m] = column(metric_names[m]);
  if (std::max({record, name, of_metric[metric_iou]}) >= head.size())
    throw Error(ExitCode::failed, path + ": expected columns record, name and iou, as " +
                                      "written by evaluate --per-record");
  const auto number = [&](const std::string& word, auto otherwise) {
    const auto read = std::from_chars(word.data(), word.data() + word.size(), otherwise);
    if (!word.empty() && (read.ec != std::errc{} || read.ptr != word.data() + word.size()))
      throw Error(ExitCode::failed, path + ": \"" + printable(word) + "\" is not a number");
    return otherwise;
  };
  std::vector<std::string> names;
  std::map<std::string, std::map<std::int64_t, std::vector<MapScores>>> lines;
  while (std::getline(text, line)) {
    auto fields = csv_fields(line);
    if (fields.size() != head.size())
      throw Error(ExitCode::failed, path + format(": a line has %zu fields; expected %zu",
                                                  fields.size(), head.size()));
    // The additional empty field is used for metrics without a column.
    fields.resize(head.size() + 1);
    MapScores scores;
    for (std::size_t m = 0; m < metric_count; ++m)
      scores[m] = number(fields[of_metric[m]], double{NAN});
    if (!lines.contains(fields[name])) names.push_back(fields[name]);
    if (fields[record].empty())
      throw Error(ExitCode::failed, path + ": a line contains no record index");
    lines[fields[name]][number(fields[record], std::int64_t{})].push_back(scores);
  }
  std::vector<NamedScores> out;
  for (const std::string& one : names) {
    out.push_back({one, {}});
    for (const auto& [index, scores] : lines[one])
      out.back().of_record[index] = mean_scores(scores);
  }
  return out;
}

}  // namespace echofuse::recon

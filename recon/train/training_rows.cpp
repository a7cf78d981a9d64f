// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>

#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/train/train.hpp"

namespace echofuse::recon {
namespace {

// Returns the path of the row's run, or of the first run if there are no rows.
std::string path_of(const Dataset& data, std::size_t row = 0) {
  if (data.sources.empty()) return "run";
  return printable(data.sources[row < data.size() ? data.source_of(row) : 0].path);
}

void require_sensors(const Dataset& data, Inputs inputs) {
  struct RequiredSensor {
    Sensor sensor;
    const char *name, *cure;
  };
  for (const auto& [sensor, name, cure] :
       {RequiredSensor{Sensor::spd, "SPD data", "use --inputs radar"},
        RequiredSensor{Sensor::radar, "radar data", "use --inputs spd"},
        RequiredSensor{Sensor::depth, "a depth map",
                       "training needs the depth camera: record with depth.address, or reconstruct "
                       "this run with a model of another run"}}) {
    if (sensor != Sensor::depth && !sensors_of(inputs).contains(sensor)) continue;
    bool found = false;
    for (std::size_t row = 0; row < data.size(); ++row) found |= data.has(row, sensor);
    if (!found)
      throw Error(ExitCode::failed,
                  format("%s: no record has %s; %s", path_of(data).c_str(), name, cure));
  }
}

}  // namespace

void apply_doubts(Dataset& data, const TrainOptions& options) {
  data.exclusions = {options.doubtful == "leave", options.lossy == "leave"};
}

TrainingRows rows_to_train(const Dataset& data, Inputs inputs) {
  if (data.size() > 0) {
    require_sensors(data, inputs);
  } else if (data.damaged.empty()) {
    throw Error(ExitCode::failed, path_of(data) + ": contains no record to train on");
  }
  std::map<std::string, std::size_t> reasons;
  std::string first_fault = data.damaged.empty() ? "" : to_text(data.damaged.front());
  bool doubtful = false;
  TrainingRows out;
  out.reasons = left_out(data, inputs);
  for (std::size_t row = 0; row < data.size(); ++row) {
    const std::string& why = out.reasons[row];
    if (why.empty()) {
      out.rows.push_back(row);
      continue;
    }
    ++reasons[why];
    doubtful |= why == doubt_of(data, row, inputs);
    if (why == dead_record && first_fault.empty())
      first_fault = format("%s: record %lld: %s", path_of(data, row).c_str(),
                           static_cast<long long>(data.records[row].index),
                           fault_of(data, row, inputs).c_str());
  }
  const std::size_t all = data.size() + data.damaged.size();
  const std::size_t none = reasons[dead_record] + data.damaged.size();
  if (static_cast<double>(none) > max_damaged * static_cast<double>(all))
    throw Error(
        ExitCode::failed,
        first_fault + format("; the sensor is dead, or the room is empty and dark; %zu of %zu "
                             "records are dead or damaged (limit 10 %%)",
                             none, all));
  reasons["damaged"] = data.damaged.size();
  out.left_out = left_out_text(reasons, all);
  if (!out.left_out.empty())
    out.left_out += (first_fault.empty() ? "" : " (" + first_fault + ")") +
                    (doubtful ? "; --set doubtful=take includes doubtful records" : "");
  const auto lossy =
      std::ranges::count_if(out.rows, [&](std::size_t row) { return is_lossy(data, row, inputs); });
  if (lossy > 0)
    out.left_out += format("%s%td lossy records are used; --set lossy=leave excludes them",
                           out.left_out.empty() ? "" : "; ", lossy);
  if (out.rows.empty()) throw Error(ExitCode::failed, path_of(data) + ": " + out.left_out);
  return out;
}

namespace {

// Returns every seventh pixel of the depth maps in `rows`, one map per row.
Matrix sampled(const Dataset& data, const Rows& rows) {
  constexpr std::size_t pixel_step = 7;
  Matrix out(rows.size(), (data.depth().cols + pixel_step - 1) / pixel_step);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto map = data.depth().row(rows[i]);
    for (std::size_t p = 0; p < out.cols; ++p) out.row(i)[p] = map[p * pixel_step];
  }
  return out;
}

// Returns the sum of absolute differences, computed in lanes that the compiler can vectorise.
double distance(std::span<const float> a, std::span<const float> b) {
  constexpr std::size_t lanes = 16;
  std::array<float, lanes> sums{};
  std::size_t p = 0;
  for (; p + lanes <= a.size(); p += lanes)
    for (std::size_t k = 0; k < lanes; ++k) sums[k] += std::abs(a[p + k] - b[p + k]);
  for (; p < a.size(); ++p) sums[p % lanes] += std::abs(a[p] - b[p]);
  return std::accumulate(sums.begin(), sums.end(), 0.0);
}

bool shows_body(std::span<const float> map, const SceneModel& scene) {
  constexpr double min_share = 0.005;
  double pixels = 0;
  for (std::size_t p = 0; p < map.size(); ++p)
    pixels += true_foreground(map[p], scene.background[p]);
  return pixels >= min_share * static_cast<double>(map.size());
}

// Returns the largest ratio of successive values in the smaller half of the sorted distances to
// other maps. The ratio is below 2 for independent maps. If a map recurs, there is a gap between
// its repetitions and the other maps.
double greatest_gap(std::vector<double> distances) {
  std::ranges::sort(distances);
  double gap = 1;
  for (std::size_t k = 0; k < distances.size() / 2; ++k)
    if (distances[k + 1] > 0) gap = std::max(gap, distances[k + 1] / std::max(distances[k], 1e-9));
  return gap;
}

}  // namespace

std::string similar_neighbours(const Dataset& data, const Rows& rows) {
  constexpr std::size_t sample = 200, others = 50;
  // Maximum fraction of records that most resemble a neighbour. For independent scenes, the
  // expected fraction is 2/52, because 2 of 52 records are neighbours.
  constexpr double max_share = 0.3;
  if (rows.size() < others) return {};
  const Matrix maps = sampled(data, rows);
  const auto apart = [&](std::size_t i, std::size_t k) {
    return distance(maps.row(i), maps.row(k));
  };
  std::size_t assessed = 0, similar = 0;
  for (std::size_t i = 1; i + 1 < rows.size(); i += rows.size() / sample + 1, ++assessed) {
    const double near = std::min(apart(i, i - 1), apart(i, i + 1));
    bool nearest = true;
    // Compares row i with distant rows, which are at least an eighth of all rows away.
    for (std::size_t k = 0; k < others && nearest; ++k)
      nearest =
          near < apart(i, (i + rows.size() / 8 + k * rows.size() * 3 / 4 / others) % rows.size());
    similar += nearest;
  }
  if (static_cast<double>(similar) <= max_share * static_cast<double>(assessed)) return {};
  return format(
      "consecutive records are alike: for %zu of %zu records, the depth map of an adjacent record "
      "is more similar than those of %zu distant records; a random split gives optimistic scores; "
      "use --split blocked",
      similar, assessed, others);
}

std::string recurring_scenes(const Dataset& data, const Split& split, const SceneModel& scene) {
  constexpr std::size_t sample = 100, min_rows = 5;
  constexpr double min_gap = 3, max_share = 0.5;
  Rows assessed;
  const std::size_t step = split.test.size() / sample + 1;
  for (std::size_t i = 0; i < split.test.size(); i += step)
    if (shows_body(data.depth().row(split.test[i]), scene)) assessed.push_back(split.test[i]);
  if (assessed.size() < min_rows) return {};
  const Matrix maps = sampled(data, assessed), training = sampled(data, split.train);
  std::vector<double> gaps(assessed.size());
  for_each_part(assessed.size(), [&](std::size_t i) {
    std::vector<double> distances(training.rows);
    for (std::size_t k = 0; k < training.rows; ++k)
      distances[k] = distance(maps.row(i), training.row(k));
    gaps[i] = greatest_gap(std::move(distances));
  });
  const auto recur = std::ranges::count_if(gaps, [](double gap) { return gap > min_gap; });
  if (static_cast<double>(recur) <= max_share * static_cast<double>(assessed.size())) return {};
  return format(
      "scenes recur: %td of %zu held-out depth maps are much closer to a training map than maps of "
      "independent scenes are; the scores are optimistic; evaluate on a run of other scenes",
      recur, assessed.size());
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include "recon/view/chooser.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "acquire/record/catalogue.hpp"
#include "drivers/program/printable.hpp"
#include "recon/view/pictures.hpp"

namespace echofuse::view {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
constexpr double longest_look_s = 0.5;
constexpr double live_pause_s = 5;  // a live run changes with each record

std::string name_of_run(const std::string& path) { return fs::path(path).stem().string(); }

// Numbers without a fraction are the shortest in JSON.
Json whole(const std::vector<float>& values, double scale) {
  Json out = Json::array();
  for (const float v : values) out.push_back(std::lround(scale * double{v}));
  return out;
}

void add_picture(Json& told, const record::RunReader& run, std::int64_t first) {
  const std::vector<Axis> axes = run.axes();
  record::MapGrid grid = record::map_grid_of(axes);
  grid.size = chooser_side;
  run.for_each(
      [&](const record::FusedRecord& r) {
        const std::vector<float> map = map_of(r, axes, grid);
        if (!map.empty())
          told["map"] = whole(map, 100);
        else if (r.has(Sensor::spd))
          told["histogram"] = whole(column_of({r.spd.begin(), r.spd.end()}), 1);
        return false;
      },
      first, [](std::int64_t, const std::string&) {}, {Sensor::spd, Sensor::depth});
}

Json told_of(const std::string& path) {
  try {
    const record::RunReader run(path);
    const record::RunEntry entry = record::entry_of(run);
    Json told = record::to_json(entry);
    told.erase("path");
    add_picture(told, run, entry.sum.last_index / 2);
    return told;
  } catch (const std::exception& e) {
    return {{"name", name_of_run(path)}, {"fault", printable(e.what(), 300)}};
  }
}

}  // namespace

std::string Chooser::path_of(const std::string& name) const {
  for (const auto& [place, path] : record::run_files(folder_))
    if (name_of_run(path) == name) return path;
  return {};
}

std::string Chooser::runs() {
  const HostTime begun = clock_.now();
  std::map<std::string, Known> known;
  std::vector<Json> all;
  for (const auto& [place, path] : record::run_files(folder_)) {
    const FileStamp stamp = stamp_of(path);
    const HostTime now = clock_.now();
    Known& run = known[path] = known_[path];
    const bool fresh = run.stamp == stamp || (stamp.written && run.stamp.written &&
                                              seconds(now - run.read) < live_pause_s);
    if ((!run.told || !fresh) && seconds(now - begun) < longest_look_s)
      run = {stamp, now, std::make_shared<Json>(told_of(path))};
    all.push_back(run.told ? *run.told : Json{{"name", name_of_run(path)}, {"waits", true}});
  }
  known_ = std::move(known);
  std::stable_sort(all.begin(), all.end(), [](const Json& a, const Json& b) {
    return a.value("started_utc", "") > b.value("started_utc", "");
  });
  return Json(all).dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace echofuse::view

// SPDX-License-Identifier: MIT
#include "recon/live/chooser.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "acquire/record/catalogue.hpp"
#include "drivers/util/printable.hpp"
#include "recon/live/pictures.hpp"

namespace echofuse::view {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
constexpr double longest_call_s = 0.5;
constexpr double live_pause_s = 5;  // minimum time between reads of a live run, s

std::string name_of_run(const std::string& path) { return fs::path(path).stem().string(); }

// Scales the values and rounds them to integers, because integers are shorter than floats in JSON.
Json whole(const std::vector<float>& values, double scale) {
  Json out = Json::array();
  for (const float v : values) out.push_back(std::lround(scale * double{v}));
  return out;
}

void add_picture(Json& out, const record::RunReader& run, std::int64_t first) {
  const std::vector<Axis> axes = run.axes();
  record::MapGrid grid = record::map_grid_of(axes);
  grid.size = chooser_side;
  run.for_each(
      [&](const record::FusedRecord& r) {
        const std::vector<float> map = map_of(r, axes, grid);
        if (!map.empty())
          out["map"] = whole(map, 100);
        else if (r.has(Sensor::spd))
          out["histogram"] = whole(column_of(clicks_of(r, axes)), 1);
        return false;
      },
      first, [](std::int64_t, const std::string&) {}, {Sensor::spd, Sensor::depth});
}

}  // namespace

// One run in the list. `more`: thumbnail of the run, or the reason why the file cannot be read.
struct Chooser::RunDescription {
  std::optional<record::RunEntry> fields;
  Json more = Json::object();

  explicit RunDescription(const std::string& path) {
    try {
      const record::RunReader run(path);
      fields = record::entry_of(run);
      const std::int64_t records = fields->sum.records;
      add_picture(more, run, fields->sum.last_index - records + 1 + records / 2);
    } catch (const std::exception& e) {
      more["fault"] = printable(e.what(), 300);
    }
  }
};

std::string Chooser::path_of(const std::string& name) const {
  for (const std::string& path : record::run_files(folder_))
    if (name_of_run(path) == name) return path;
  return {};
}

std::string Chooser::runs() {
  const HostTime begun = clock_.now();
  std::map<std::string, CachedRun> known;
  std::vector<Json> all;
  for (const std::string& path : record::run_files(folder_)) {
    const FileStamp stamp = stamp_of(path);
    const HostTime now = clock_.now();
    CachedRun& run = known[path] = known_[path];
    const bool fresh = run.stamp == stamp || (stamp.written && run.stamp.written &&
                                              seconds(now - run.read) < live_pause_s);
    if ((!run.entry || !fresh) && seconds(now - begun) < longest_call_s)
      run = {stamp, now, std::make_shared<RunDescription>(path)};
    const bool readable = run.entry && run.entry->fields;
    Json& shown = all.emplace_back(readable ? record::to_json(*run.entry->fields)
                                            : Json{{"name", name_of_run(path)}});
    shown.erase("path");
    shown.update(run.entry ? run.entry->more : Json{{"waits", true}});
  }
  known_ = std::move(known);
  std::stable_sort(all.begin(), all.end(), [](const Json& a, const Json& b) {
    return a.value("started_utc", "") > b.value("started_utc", "");
  });
  return Json(all).dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace echofuse::view

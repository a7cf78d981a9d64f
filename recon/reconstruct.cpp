// SPDX-License-Identifier: MIT
#include "recon/reconstruct.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "acquire/record/depth_map.hpp"
#include "acquire/record/png.hpp"
#include "drivers/core/console.hpp"
#include "recon/figure.hpp"
#include "recon/files.hpp"
#include "recon/text.hpp"

namespace echofuse::recon {
namespace {

constexpr int zoom = 4;

Bytes millimetre_picture(std::span<const float> map) {
  std::vector<std::uint16_t> mm(map.size());
  for (std::size_t p = 0; p < map.size(); ++p)
    mm[p] = static_cast<std::uint16_t>(std::lround(map[p] * 1000));
  return record::encode_png16(mm, record::map_size, record::map_size);
}

// The farthest depth that the training maps knew, so that one scale serves the whole run.
double farthest_of(const Scene& scene) {
  const float wall = *std::max_element(scene.background.begin(), scene.background.end());
  return std::clamp(std::ceil(double{std::max(wall, scene.foreground_depth_m)} + 0.5), 1.0,
                    record::max_depth_m);
}

std::string to_csv(const std::vector<RecordStatus>& records) {
  std::string out = "record,status\n";
  for (const auto& r : records)
    out += std::to_string(r.index) + ",\"" + (r.fault.empty() ? "ok" : r.fault) + "\"\n";
  return out;
}

}  // namespace

std::vector<RecordStatus> reconstruct(const TrainedModel& model, const std::string& run,
                                      const ReconstructOptions& options) {
  std::vector<RecordStatus> status;
  Dataset data = load({run}, [&](std::int64_t index, const std::string& fault) {
    status.push_back({index, fault});
  });
  const Features& f = model.features;
  match_axes(data, f.spd_axis, f.radar_axis, f.inputs);
  make_folder(options.out);
  const double farthest_m = farthest_of(model.scene);
  Progress progress("reconstructing", data.size(), options.quiet);
  for (std::size_t row = 0; row < data.size() && !interrupted(); ++row) {
    status.push_back({data.index[row], data.has_inputs(row, f.inputs)
                                           ? ""
                                           : std::string("lacks a sensor that the model needs: ") +
                                                 name_of(f.inputs)});
    if (!status.back().fault.empty()) continue;
    const auto map = within_span(model.predict(data, {row}).row(0));
    const std::string name =
        options.out + formatted("/%06lld", static_cast<long long>(data.index[row]));
    if (options.colour) write_file(name + ".png", depth_picture(map, farthest_m, zoom));
    if (options.millimetres) write_file(name + "_mm.png", millimetre_picture(map));
    progress.update(row + 1);
  }
  std::sort(status.begin(), status.end(),
            [](const auto& a, const auto& b) { return a.index < b.index; });
  const std::string csv = to_csv(status);
  write_file(options.out + "/records.csv", Bytes(csv.begin(), csv.end()));
  return status;
}

}  // namespace echofuse::recon

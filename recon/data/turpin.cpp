// SPDX-License-Identifier: MIT
#include "recon/data/turpin.hpp"

#include <algorithm>
#include <cmath>

#include "acquire/record/depth_map.hpp"
#include "acquire/record/run_file.hpp"
#include "drivers/core/console.hpp"
#include "recon/files/npy.hpp"

namespace echofuse::recon {
namespace {

NpyArray read_checked(const std::string& path, std::size_t dimensions) {
  NpyArray out = read_npy(path);
  if (out.shape.size() != dimensions)
    throw Error(ExitCode::failed, path + ": has " + std::to_string(out.shape.size()) +
                                      " dimensions; expected " + std::to_string(dimensions));
  return out;
}

NpyArray read_maps(const std::string& path, std::size_t frames) {
  NpyArray maps = read_checked(path, 3);
  const std::size_t size = maps.shape[1];
  if (maps.shape[0] != frames || maps.shape[2] != size || size < record::least_map_size ||
      size > record::most_map_size)
    throw Error(ExitCode::failed, path + ": expected " + std::to_string(frames) +
                                      " square maps of 16 to 256 pixels a side, one a histogram");
  return maps;
}

std::vector<std::uint16_t> to_mm(std::span<const float> map) {
  std::vector<std::uint16_t> out;
  for (const float v : map)
    out.push_back(static_cast<std::uint16_t>(
        std::lround(std::clamp(double{v}, 0.0, 1.0) * turpin_scale_m * 1000)));
  return out;
}

void write_run(const std::string& path, const NpyArray& histograms, const NpyArray& maps,
               const std::string& notes) {
  record::RunInfo info;
  info.version = version();
  info.notes = notes;
  record::RunWriter run(path, info);
  const std::size_t frames = histograms.shape[0], bins = histograms.shape[1];
  const std::size_t pixels = maps.values.size() / frames;
  run.put_axis({"radar", "power", "bin", static_cast<std::uint32_t>(bins), 0, 1, 1});
  record::MapGrid map;
  map.size = static_cast<std::uint32_t>(maps.shape[1]);
  for (const Axis& axis : map.run_axes()) run.put_axis(axis);
  std::vector<record::FusedRecord> records(frames);
  for (std::size_t i = 0; i < frames; ++i) {
    record::FusedRecord& r = records[i];
    r.index = static_cast<std::int64_t>(i);
    const auto profile = std::span(histograms.values).subspan(i * bins, bins);
    r.radar.assign(profile.begin(), profile.end());
    r.depth_mm = to_mm(std::span(maps.values).subspan(i * pixels, pixels));
    r.valid.insert(Sensor::radar);
    r.valid.insert(Sensor::depth);
  }
  run.append(records);
  run.close_as_one_file("complete");
}

constexpr const char* notes =
    "Imported from Turpin et al., Optica 7, 900 (2020). Depths are in units of the scene's "
    "maximum, "
    "stored as if that were 6 m; the field of view is nominal; range bins carry no metres.";

}  // namespace

std::int64_t import_turpin(const std::string& dir, const std::string& out,
                           const std::string& published_out) {
  const NpyArray histograms = read_checked(dir + "/histogram.npy", 2);
  const std::size_t frames = histograms.shape[0];
  if (histograms.values.empty())
    throw Error(ExitCode::failed, dir + "/histogram.npy: is empty; expected frames x bins");
  write_run(out, histograms, read_maps(dir + "/depth.npy", frames), notes);
  if (!published_out.empty())
    write_run(published_out, histograms, read_maps(dir + "/published.npy", frames),
              std::string(notes) + " The depth maps are the published reconstruction.");
  return static_cast<std::int64_t>(frames);
}

}  // namespace echofuse::recon

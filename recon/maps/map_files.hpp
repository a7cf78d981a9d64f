// SPDX-License-Identifier: MIT
// Depth maps as files of the requested formats.
#pragma once
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "recon/maps/written_maps.hpp"
#include "recon/metrics/scene_model.hpp"

namespace echofuse::recon {

// Colour scale of all maps of a model.
struct DepthSpan {
  double near = 2.5, far = 5;  // m
};

// Formats of N x N maps. To add one: a row in map_files.cpp, and its branch in MapFiles::prepare.
//   colour  NNNNNN.png: picture of the foreground
//   mm      NNNNNN_mm.png: 16-bit grey, z in millimetres, 0 = no return
//   ply     NNNNNN.ply: points x (right), y (down), z (away) in metres, the right-handed frame of
//           camera.json, in the picture's colours; from the thresholded map (scene_model.hpp),
//           because the ripple of a least-squares map would give scattered points
//   npy     maps.npy with all maps: float32 [n, N, N], metres, NaN: no return; records.csv lists
//           their records. `evaluate --maps` reads both.
//   foreground  thresholded.npy, like maps.npy, and share.npy: foreground_share (scene_model.hpp)
//   uncertainty  NNNNNN_sd.png: 16-bit grey, standard deviation of z in millimetres, 0 if the
//           estimator states none; together with npy also deviation.npy with NaN for 0
// In addition camera.json: pinhole camera of the images, in pixels, and the number of steps per
// metre in NNNNNN_mm.png.
std::vector<std::string> map_format_names();
std::string map_format_help();  // one line per format

// Writes into an existing folder; every member throws Error(disk).
class MapFiles {
 public:
  MapFiles(std::string folder, const std::vector<std::string>& formats, const SceneModel& scene);
  // Files of one map, in memory. `deviation`: standard deviation of each pixel, m; may be empty
  // unless the format uncertainty is requested. Threading: any thread may call prepare().
  struct MapFile {
    std::string path;
    Bytes contents;
  };
  struct Ready {
    std::int64_t index;
    std::vector<MapFile> pictures;
    std::map<std::string, std::vector<float>> rows;  // rows appended to NAME.npy
  };
  Ready prepare(std::int64_t index, std::span<const float> prediction,
                std::span<const float> deviation) const;
  void write(const Ready& ready);
  void close();  // completes the files of all maps

 private:
  bool wants(const char* format) const;
  std::string folder_;
  std::vector<std::string> formats_;
  const SceneModel& scene_;
  DepthSpan span_;
  std::map<std::string, NpyWriter> arrays_;  // by name
};

}  // namespace echofuse::recon

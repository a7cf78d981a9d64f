// SPDX-License-Identifier: MIT
// Writes depth maps to files in the requested formats.
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

// Range of the colour scale, common to all maps of a model.
struct DepthSpan {
  double near = 2.5, far = 5;  // m
};

// Returns the names of the formats of N x N maps (NNNNNN is the record index):
//   colour  NNNNNN.png: colour picture of the foreground
//   mm      NNNNNN_mm.png: 16-bit greyscale picture of z in millimetres; 0: no return
//   ply     NNNNNN.ply: point cloud with x (right), y (down), z (away) in metres, in the
//           right-handed frame of camera.json, with the colours of the picture. The points are
//           those of the thresholded map (scene_model.hpp), because a least-squares map has a
//           ripple that would scatter the points.
//   npy     maps.npy with all maps as float32 [n, N, N], in metres; NaN: no return. records.csv
//           lists the records of the maps. `evaluate --maps` reads both files.
//   foreground   thresholded.npy, in the format of maps.npy, and share.npy with the foreground
//                fraction of each pixel (foreground_share in scene_model.hpp)
//   uncertainty  NNNNNN_sd.png: 16-bit greyscale picture of the standard deviation of z in
//                millimetres; 0: unknown. If npy is also requested, deviation.npy is written as
//                well, with NaN instead of 0.
// camera.json is always written. It contains the pinhole camera of the images, in pixels, and the
// number of grey levels per metre in NNNNNN_mm.png. A new format needs a row in map_files.cpp and a
// branch in MapFiles::prepare().
std::vector<std::string> map_format_names();
std::string map_format_help();  // returns "NAME (DESCRIPTION), NAME (DESCRIPTION), ..."

// Writes maps into an existing folder. Every function that writes throws Error(disk) on failure.
class MapFiles {
 public:
  MapFiles(std::string folder, const std::vector<std::string>& formats, const SceneModel& scene);
  struct MapFile {
    std::string path;
    Bytes contents;
  };
  struct Ready {
    std::int64_t index;
    std::vector<MapFile> pictures;
    // Row to be appended to each array file NAME.npy; the key is NAME.
    std::map<std::string, std::vector<float>> rows;
  };
  // Returns the files of one map, in memory. `deviation`: standard deviation of each pixel, m; may
  // be empty unless the format "uncertainty" is requested. Threading: any thread.
  Ready prepare(std::int64_t index, std::span<const float> prediction,
                std::span<const float> deviation) const;
  void write(const Ready& ready);
  void close();  // completes the array files

 private:
  bool wants(const char* format) const;
  std::string folder_;
  std::vector<std::string> formats_;
  const SceneModel& scene_;
  DepthSpan span_;
  std::map<std::string, NpyWriter> arrays_;  // array files by name
};

}  // namespace echofuse::recon

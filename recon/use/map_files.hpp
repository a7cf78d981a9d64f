// SPDX-License-Identifier: MIT
// Depth maps as files, in the formats that are asked for.
#pragma once
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "recon/metrics/scene.hpp"
#include "recon/use/written_maps.hpp"

namespace echofuse::recon {

// One scale of colours for all maps of a model.
struct DepthSpan {
  double near = 2.5, far = 5;  // m
};

// Maps of N x N pixels, as the model's. To add one: a row in map_files.cpp, and its branch in
// MapFiles::prepare.
//   colour  NNNNNN.png: for the eye, where the map says that something is there
//   mm      NNNNNN_mm.png: 16-bit grey, z in millimetres, 0 = no return
//   ply     NNNNNN.ply: points x (right), y (down), z (away) in metres, the right-handed frame of
//           camera.json, with the picture's colours, of the thresholded map (scene.hpp), as the
//           ripple of a least-squares map would be a fog of points
//   npy     maps.npy for all: float32 [n, N, N], metres, NaN where nothing returned; records.csv
//           names their records. `evaluate --maps` reads both.
//   foreground  thresholded.npy, as maps.npy, and share.npy: foreground_share (scene.hpp)
//   uncertainty  NNNNNN_sd.png: 16-bit grey, the standard deviation of z in millimetres, 0 if the
//           estimator that answered states none; beside npy also deviation.npy, NaN there
// Beside all of them camera.json: the pinhole camera whose images they are, in pixels, and the
// steps of a metre in NNNNNN_mm.png.
std::vector<std::string> map_format_names();
std::string map_format_help();  // a line for each format

// Writes into an existing folder; every member throws Error(disk).
class MapFiles {
 public:
  MapFiles(std::string folder, const std::vector<std::string>& formats, const Scene& scene);
  // Files of one map, ready to be written. `deviation`: standard deviation of each pixel, m; may be
  // empty unless uncertainty is wanted. Threading: any thread may call prepare().
  struct File {
    std::string path;
    Bytes contents;
  };
  struct Ready {
    std::int64_t index;
    std::vector<File> pictures;
    std::map<std::string, std::vector<float>> rows;  // appended to NAME.npy
  };
  Ready prepare(std::int64_t index, std::span<const float> prediction,
                std::span<const float> deviation) const;
  void write(const Ready& ready);
  void close();  // finishes what holds all maps

 private:
  bool wants(const char* format) const;
  std::string folder_;
  std::vector<std::string> formats_;
  const Scene& scene_;
  DepthSpan span_;
  std::map<std::string, NpyWriter> arrays_;  // by name
};

}  // namespace echofuse::recon

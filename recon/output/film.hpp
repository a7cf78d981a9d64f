// SPDX-License-Identifier: MIT
// A film of a run's maps, by ffmpeg.
#pragma once
#include <sys/types.h>

#include <optional>
#include <string>
#include <utility>

#include "drivers/chart/colour_map.hpp"
#include "drivers/core/atomic_write.hpp"

namespace echofuse::recon {

inline constexpr int film_frames_per_s = 10, film_zoom = 8;

// As the name's ending says: .mp4 or .gif. Throws Error(failed) if ffmpeg is not there, or cannot
// write it.
class Film {
 public:
  explicit Film(std::string path) : path_(std::move(path)) {}  // replaces one that is there
  ~Film();
  Film(const Film&) = delete;
  Film& operator=(const Film&) = delete;
  void add(const chart::Raster& picture);  // all of one size
  void close();

 private:
  void start(const chart::Raster& first);
  int stop();
  std::string path_;
  std::optional<UnfinishedFile> file_;
  pid_t program_ = 0;
  int input_ = -1;
};

}  // namespace echofuse::recon

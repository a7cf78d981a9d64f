// SPDX-License-Identifier: MIT
// Reads maps written by any program, for evaluation, and writes the file of all maps. Formats:
//   FOLDER/maps.npy      [n, N, N] metres, row-major from the top left, NaN or 0: no return
//   FOLDER/records.csv   columns record (index) and status, in the order of the maps; a record has
//                        a map if its status begins with "ok", "radar lost" or "antennas lost"
// or 16-bit pictures FOLDER/NNNNNN_mm.png (otherwise NNNNNN.png) of record NNNNNN, with
//   FOLDER/camera.json   width, fx, and depth_scale (steps per metre)
// FOLDER/run.txt (optional): the run (uuid, path), and the training records of the maps' model as
// "trained on records 0,1,5".
#pragma once
#include <cstdint>
#include <fstream>
#include <map>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "drivers/util/new_file.hpp"
#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// Prefix of the line in run.txt that lists the training records.
inline constexpr const char* trained_on_records = "trained on records ";

struct WrittenMaps {
  std::string name;                                     // name of the folder
  std::map<std::int64_t, std::vector<float>> of_index;  // metres, 0: no return
  std::vector<std::int64_t> without;                    // listed records without a map
  std::string uuid, path;                               // uuid and path from run.txt; may be empty
  std::set<std::int64_t> trained_on;                    // training records of the maps' model
};
// Throws Error(failed): neither format, another grid, or values that are not depths in metres.
WrittenMaps read_written_maps(const std::string& folder, const record::MapGrid& grid);

// Returns why each row is not scored; empty if it is. Reasons: no depth, a doubt, a copy within the
// run, and, unless `all`, a training record of a folder's model. Throws Error(failed) for maps of
// another run.
std::vector<std::string> left_out_of_maps(const std::vector<WrittenMaps>& folders,
                                          const Dataset& data, bool all);
// Returns the number of rows with a map. Throws Error(failed) if none has one.
std::size_t count_maps(const WrittenMaps& maps, const Dataset& data, const Rows& rows);
// Returns the maps of these rows; a missing map is replaced by `empty`.
Matrix maps_of(const WrittenMaps& maps, const Dataset& data, const Rows& rows,
               const std::vector<float>& empty);

// Writes a .npy file row by row; it is published by close(). Throws Error(disk).
class NpyWriter {
 public:
  NpyWriter(const std::string& path, std::vector<std::size_t> row_shape);
  void append(std::span<const float> row);
  void close();

 private:
  void flush();
  std::string path_;
  NewFile file_;
  std::fstream out_;
  std::vector<std::size_t> row_shape_;
  std::vector<float> waiting_;  // buffer, because a system call per map takes as long as the map
  std::uint64_t rows_ = 0;
};

}  // namespace echofuse::recon

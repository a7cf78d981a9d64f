// SPDX-License-Identifier: MIT
// Reads maps made by any program, so that they can be scored, and writes arrays of maps. A folder
// contains either an array
//   FOLDER/maps.npy      [n, N, N] metres, row-major from the top left, NaN or 0: no return
//   FOLDER/records.csv   columns record (index) and status, in the order of the maps; a record has
//                        a map if its status begins with "ok", "radar lost" or "antennas lost"
// or 16-bit pictures FOLDER/NNNNNN_mm.png (otherwise NNNNNN.png) of record NNNNNN, with
//   FOLDER/camera.json   width, fx, and depth_scale (steps per metre)
// FOLDER/run.txt is optional. It contains the run (uuid, path) and the training records of the
// model that made the maps, as "trained on records 0,1,5".
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
  std::string name;
  // Maps by record index; depths in metres, 0: no return.
  std::map<std::int64_t, std::vector<float>> of_index;
  // Indices of the records that records.csv lists as having no map.
  std::vector<std::int64_t> without;
  std::string uuid, path;  // UUID and path of the run, read from run.txt; may be empty
  // Indices of the records on which the model that made the maps was trained.
  std::set<std::int64_t> trained_on;
};
// Reads the maps in a folder. Throws Error(failed) if the folder contains neither maps.npy nor
// PNGs, or if the grid of the maps differs from `grid`. Also throws if a value is not a possible
// depth in metres.
WrittenMaps read_written_maps(const std::string& folder, const record::MapGrid& grid);

// For each row, returns why it is not scored, or an empty string if it is scored. Reasons: the
// depth map is missing or doubtful; the row is a copy of an earlier record of the run; the model
// that made the maps was trained on the record (unless `all` is true). Throws Error(failed) if the
// maps belong to a run other than that of `data`.
std::vector<std::string> left_out_of_maps(const std::vector<WrittenMaps>& folders,
                                          const Dataset& data, bool all);
// Returns the number of rows that have a map. Throws Error(failed) if no row has one.
std::size_t count_maps(const WrittenMaps& maps, const Dataset& data, const Rows& rows);
// Returns the maps of these rows. A missing map is replaced by `empty`.
Matrix maps_of(const WrittenMaps& maps, const Dataset& data, const Rows& rows,
               const std::vector<float>& empty);

// Writes a .npy file row by row; close() moves the finished file to its path. Throws Error(disk) if
// writing fails.
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
  std::vector<float> waiting_;  // buffer, because a system call for each map would be slow
  std::uint64_t rows_ = 0;
};

}  // namespace echofuse::recon

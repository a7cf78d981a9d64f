// SPDX-License-Identifier: MIT
// Maps as files that any program can make, read to be judged, and the file of all maps written.
//   FOLDER/maps.npy      [n, N, N] metres, row-major from the top left, NaN or 0: no return
//   FOLDER/records.csv   columns record (its index) and status, in the order of the maps;
//                        a status that begins with "ok", "radar lost" or "antennas lost" has a map
// or 16-bit pictures FOLDER/NNNNNN_mm.png (else NNNNNN.png), NNNNNN the record's index, with
//   FOLDER/camera.json   width, fx, and depth_scale, the steps a metre
#pragma once
#include <cstdint>
#include <fstream>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "drivers/program/new_file.hpp"
#include "recon/data/dataset.hpp"

namespace echofuse::recon {

struct WrittenMaps {
  std::string name;                                     // the folder's
  std::map<std::int64_t, std::vector<float>> of_index;  // metres, 0: no return
  std::vector<std::int64_t> without;                    // records that are listed and have no map
};
// Throws Error(failed): neither kind of files, another grid, values that are no depths in metres.
WrittenMaps read_written_maps(const std::string& folder, const record::MapGrid& grid);

// Rows with a depth of which every folder has a map. Throws Error(failed) that names the first
// record with depth that a folder does not know.
Rows rows_with_maps(const std::vector<WrittenMaps>& all, const Dataset& data);
Matrix maps_of(const WrittenMaps& maps, const Dataset& data, const Rows& rows);

// Writes a .npy file row by row; it appears at its place when it is closed. Throws Error(disk).
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
  std::vector<float> waiting_;  // a system call for a single map takes as long as the map
  std::uint64_t rows_ = 0;
};

}  // namespace echofuse::recon

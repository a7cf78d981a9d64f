// SPDX-License-Identifier: MIT
// Maps as files that any program can make, read to be judged, and the file of all maps written.
//   FOLDER/maps.npy      [n, N, N] metres, row-major from the top left, NaN or 0: no return
//   FOLDER/records.csv   columns record (its index) and status, in the order of the maps;
//                        a status that begins with "ok", "radar lost" or "antennas lost" has a map
// or 16-bit pictures FOLDER/NNNNNN_mm.png (else NNNNNN.png), NNNNNN the record's index, with
//   FOLDER/camera.json   width, fx, and depth_scale, the steps a metre
// FOLDER/run.txt, if there is one, names the run (uuid, path) and the records "trained on records
// 0,1,5": on which the maps' model was trained
#pragma once
#include <cstdint>
#include <fstream>
#include <map>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "drivers/program/new_file.hpp"
#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// Begins the line of run.txt with the records that trained the model.
inline constexpr const char* trained_on_records = "trained on records ";

struct WrittenMaps {
  std::string name;                                     // the folder's
  std::map<std::int64_t, std::vector<float>> of_index;  // metres, 0: no return
  std::vector<std::int64_t> without;                    // records that are listed and have no map
  std::string uuid, path;             // run.txt: uuid and path of the run, or empty
  std::set<std::int64_t> trained_on;  // records that trained the maps' model
};
// Throws Error(failed): neither kind of files, another grid, values that are no depths in metres.
WrittenMaps read_written_maps(const std::string& folder, const record::MapGrid& grid);

// Returns why each row is not judged; empty if it is. Reasons: no depth, a doubt, twice in the run,
// and, unless `all`, in the training of a folder's model. Throws Error(failed) for maps of another
// run.
std::vector<std::string> left_out_of_maps(const std::vector<WrittenMaps>& folders,
                                          const Dataset& data, bool all);
// Returns how many of the rows have a map. Throws Error(failed) if none has.
std::size_t answered_by(const WrittenMaps& maps, const Dataset& data, const Rows& rows);
// Returns the maps of these rows; `empty` stands for a missing one.
Matrix maps_of(const WrittenMaps& maps, const Dataset& data, const Rows& rows,
               const std::vector<float>& empty);

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

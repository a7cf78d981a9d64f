// SPDX-License-Identifier: MIT
// Depth maps of a whole run, also of one that is being recorded.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "recon/use/predict.hpp"

namespace echofuse::recon {

struct ReconstructOptions {
  std::string out;                                      // folder, made if need be
  std::vector<std::string> formats = {"colour", "mm"};  // names in map_files.hpp
  std::string rows;           // indices of records, as "3,7", or "test": held out; empty: all
  bool follow = false;        // take records as they come, until the run is closed
  bool force = false;         // also into a folder that holds maps of another run
  bool quiet = false;         // no progress bar, and of the run only what is unusual
  double range_offset_m = 0;  // by how much the radar's ranges are too long (prepare_records)
  // Receives notes about the run's antennas (Records). For a whole run also tells whether it is
  // unlike the training (DomainShift::text).
  std::function<void(const std::string&)> on_run;
  std::function<void(const RecordStatus&)> on_record;  // in the order of the records
};

// Reconstructs one run: reads records, predicts maps, writes files and OUT/records.csv as they
// come. Notes and leaves out a record that cannot be used (bad blob, missing or dead sensor). Ends
// early at an interrupt, with what it has finished. OUT/run.txt names the run of the maps (uuid,
// path, whether calibrated). Throws Error(failed) if the run's axes are not the model's or lacks
// one of the rows, and Error(disk). Throws Error(usage) if there are maps of another run, unless
// forced.
void reconstruct(const TrainedModel& model, const std::string& run,
                 const ReconstructOptions& options);

}  // namespace echofuse::recon

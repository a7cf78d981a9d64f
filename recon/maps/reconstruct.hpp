// SPDX-License-Identifier: MIT
// Depth maps of a run, complete or in progress.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "recon/predict/predict.hpp"

namespace echofuse::recon {

struct ReconstructOptions {
  std::string out;                                      // folder, created if missing
  std::vector<std::string> formats = {"colour", "mm"};  // names of map_files.hpp
  std::string rows;           // record indices ("3,7"), or "test" (held-out records); empty: all
  bool follow = false;        // also reconstruct new records until the run is closed
  bool force = false;         // allow a folder with maps of another run
  bool quiet = false;         // no progress bar; print only warnings about the run
  double range_offset_m = 0;  // radar range bias to subtract (prepare_records)
  // Receives notes about the run (Records). For a complete run also receives the result of the
  // domain test (DomainShift::text).
  std::function<void(const std::string&)> on_run;
  std::function<void(const RecordStatus&)> on_record;  // in record order
};

// Reconstructs one run: reads records, predicts maps, writes files and OUT/records.csv
// progressively. Reports and leaves out unusable records (bad blob, missing or dead sensor). An
// interrupt ends it after the finished records. OUT/run.txt names the run of the maps (uuid, path,
// whether calibrated). Throws Error(failed) if the axes do not match the model's or a requested
// record is missing, and Error(disk). Throws Error(usage) if the folder contains maps of another
// run, unless forced.
void reconstruct(const TrainedModel& model, const std::string& run,
                 const ReconstructOptions& options);

}  // namespace echofuse::recon

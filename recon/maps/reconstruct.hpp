// SPDX-License-Identifier: MIT
// Reconstructs the depth maps of a run, which may still be in progress.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "recon/predict/predict.hpp"

namespace echofuse::recon {

struct ReconstructOptions {
  std::string out;                                      // output folder, created if missing
  std::vector<std::string> formats = {"colour", "mm"};  // names of formats (map_files.hpp)
  std::string rows;           // record indices ("3,7"), or "test" (held-out records); empty: all
  bool follow = false;        // true: reconstruct new records until the run is closed
  bool force = false;         // true: accept an output folder that contains maps of another run
  bool quiet = false;         // true: hide the progress bar and print only warnings
  double range_offset_m = 0;  // radar range bias to be subtracted, m (see prepare_records)
  // Receives notes about the run (see Records) and, if the run is complete, the result of the
  // domain test (DomainShift::text).
  std::function<void(const std::string&)> on_run;
  std::function<void(const RecordStatus&)> on_record;  // called in record order
};

// Reconstructs one run: reads records, predicts maps, and writes files and OUT/records.csv
// progressively. Reports unusable records (unreadable data, missing or dead sensor) and does not
// make maps for them. After an interrupt, the finished maps are kept. OUT/run.txt contains the
// run's UUID and path, and states whether the model is calibrated. Throws Error(failed) if the axes
// do not match those of the model or a requested record is missing; Error(disk) if writing fails;
// Error(usage) if the folder contains maps of another run, unless options.force is set.
void reconstruct(const TrainedModel& model, const std::string& run,
                 const ReconstructOptions& options);

}  // namespace echofuse::recon

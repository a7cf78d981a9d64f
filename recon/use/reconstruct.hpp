// SPDX-License-Identifier: MIT
// Depth maps of a whole run, also of one that is being recorded.
#pragma once
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "recon/metrics/metrics.hpp"
#include "recon/use/trained_model.hpp"

namespace echofuse::recon {

struct RecordStatus {
  std::int64_t index = 0;
  std::string fault;  // empty: reconstructed
  std::string note;   // of a map: what the model had to do without
  // It is of a record that came while following: from its slot's end, and from its reading, to its
  // map.
  std::optional<double> after_slot_s = {}, after_reading_s = {};
  // Set for a reconstructed record whose map shows a body.
  std::optional<BodyPlace> body = {};
  // It is of a reconstructed record, if the model states any.
  std::optional<PredictionUncertainty> uncertainty = {};
};

struct ReconstructOptions {
  std::string out;                                      // folder, made if need be
  std::vector<std::string> formats = {"colour", "mm"};  // of map_files.hpp
  bool follow = false;        // take records as they come, until the run is closed
  bool force = false;         // also into a folder that holds maps of another run
  bool quiet = false;         // no progress bar, and of the run only what is unusual
  double range_offset_m = 0;  // by how much the radar's ranges are too long (prepare_records)
  // This is what there is to say of the run: of its antennas (Records), and of a whole run, whether
  // it is unlike the training (DomainShift::text).
  std::function<void(const std::string&)> on_run;
  std::function<void(const RecordStatus&)> on_record;  // in the order of the records
};

// Maps in every format for each record, and OUT/records.csv with what became of each and how far to
// trust it, written as they come. A record that cannot be used (bad blob, missing or dead sensor)
// is noted and left out. Ends early at an interrupt, with what it has finished. Throws
// Error(failed) if the run's axes are not the model's, and Error(disk). OUT/run.txt tells whose
// maps they are (uuid, path, whether calibrated); Error(usage) if there are maps of another run,
// unless forced.
void reconstruct(const TrainedModel& model, const std::string& run,
                 const ReconstructOptions& options);

}  // namespace echofuse::recon

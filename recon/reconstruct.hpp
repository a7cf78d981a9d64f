// SPDX-License-Identifier: MIT
// Depth maps of a whole run as pictures.
#pragma once
#include <string>
#include <vector>

#include "recon/trained_model.hpp"

namespace echofuse::recon {

struct ReconstructOptions {
  std::string out;          // folder, made if need be
  bool colour = true;       // NNNNNN.png: for the eye
  bool millimetres = true;  // NNNNNN_mm.png: 16-bit grey, z in millimetres, 0 = no return
  bool quiet = false;
};

struct RecordStatus {
  std::int64_t index = 0;
  std::string fault;  // empty: reconstructed
};

// One or two pictures a record, and OUT/records.csv with what became of each. A record that cannot
// be used (bad blob, missing sensor) is noted and left out.
std::vector<RecordStatus> reconstruct(const TrainedModel& model, const std::string& run,
                                      const ReconstructOptions& options);

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
/// @file
/// Model file: what `echofuse-recon train` writes.
#pragma once
#include <cstddef>
#include <memory>
#include <string>

#include "echofuse/record.hpp"

namespace echofuse {

/// A trained model. It does not change; copies share its weights. Threading: any number of threads
/// may use one model.
class Model {
 public:
  /// Loads a model file. Throws std::runtime_error that names the file and the fault: missing,
  /// damaged, or of another format.
  explicit Model(const std::string& path);

  /// Returns the kind of the model, as `factorised-16`.
  const std::string& name() const;
  /// Returns the sensors that it takes: `fused`, `fused-profile` (the radar without its antennas),
  /// `spd` or `radar`.
  const std::string& inputs() const;
  /// Returns true if the model states the errors of its maps.
  bool calibrated() const;
  /// Returns the bins of the histogram; count 0 if the model takes no detector.
  RunAxis spd_axis() const;
  /// Returns the points of the range profile; count 0 if the model takes no radar.
  RunAxis radar_axis() const;
  /// Returns the number of histograms in a record: 1 for a single pixel, or for the sum of zones.
  std::size_t zones() const;
  /// Returns the grid of its maps.
  MapGrid grid() const;

 private:
  friend struct Internals;
  struct File;
  std::shared_ptr<const File> file_;
};

}  // namespace echofuse

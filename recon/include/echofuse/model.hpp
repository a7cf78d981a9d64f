// SPDX-License-Identifier: MIT
/// @file
/// Reads model files written by `echofuse-recon train`.
#pragma once
#include <cstddef>
#include <memory>
#include <string>

#include "echofuse/record.hpp"

namespace echofuse {

/// A trained model. It is immutable, and its copies share the weights. Threading: any number of
/// threads may use one model.
class Model {
 public:
  /// Loads a model file. Throws std::runtime_error with the file name and the fault if the file is
  /// missing, damaged or in a different format.
  explicit Model(const std::string& path);

  /// Returns the name of the model, e.g. `factorised-16`.
  const std::string& name() const;
  /// Returns the sensors that the model uses: `fused`, `fused-profile` (the radar's range profile
  /// without antenna samples), `spd` or `radar`.
  const std::string& inputs() const;
  /// Returns true if the model estimates the errors of its maps.
  bool calibrated() const;
  /// Returns the axis of the histogram bins; its count is 0 if the model does not use the detector.
  RunAxis spd_axis() const;
  /// Returns the axis of the range profile; its count is 0 if the model does not use the radar.
  RunAxis radar_axis() const;
  /// Returns the number of histograms that the model expects per record: one per zone, or 1 for a
  /// single pixel or for the sum over the zones.
  std::size_t zones() const;
  /// Returns the pixel grid of the model's depth maps.
  MapGrid grid() const;

 private:
  friend struct Internals;
  struct File;
  std::shared_ptr<const File> file_;
};

}  // namespace echofuse

// SPDX-License-Identifier: MIT
/// @file
/// Reads model files written by `echofuse-recon train`.
#pragma once
#include <cstddef>
#include <memory>
#include <string>

#include "echofuse/record.hpp"

namespace echofuse {

/// Immutable trained model; copies share its weights. Threading: any number of threads may use the
/// same Model at once.
class Model {
 public:
  /// Loads a model file. Throws Exception if the file is missing, damaged or in a
  /// different format; the message contains the file name and the fault.
  explicit Model(const std::string& path);

  /// Returns the name of the model, e.g. `factorised-16`.
  [[nodiscard]] const std::string& name() const;
  /// Returns the sensors that the model uses: `fused`, `fused-profile` (the radar's range profile
  /// without antenna samples), `spd` or `radar`.
  [[nodiscard]] const std::string& inputs() const;
  /// Returns true if the model also estimates the errors of the maps that it predicts.
  [[nodiscard]] bool calibrated() const;
  /// Returns the axis of the histogram bins; its count is 0 if the model does not use the detector.
  [[nodiscard]] RunAxis spd_axis() const;
  /// Returns the axis of the range profile; its count is 0 if the model does not use the radar.
  [[nodiscard]] RunAxis radar_axis() const;
  /// Returns the number of histograms that the model expects per record: one per detector zone, or
  /// 1 if the model uses a single pixel or the sum over all zones.
  [[nodiscard]] std::size_t zones() const;
  /// Returns the pixel grid of the model's depth maps.
  [[nodiscard]] MapGrid grid() const;

 private:
  friend struct Internals;
  struct File;
  std::shared_ptr<const File> file_;
};

}  // namespace echofuse

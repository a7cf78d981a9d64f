// SPDX-License-Identifier: MIT
// Compares the static echoes of a run, e.g. of walls and the floor, with those of the training.
// Both sensors see them. If the static part of the histogram and of the range profile is unchanged
// but for a shift of up to 15 cm, the difference between the two shifts is a range error: a sensor
// has moved, or an offset is wrong. Corrects nothing. Cannot detect a range error in a room without
// static echoes, in another room, or if furniture was moved. Profiles with steps of a whole range
// cell and without a window cannot be interpolated: the difference is then not found, or 6 mm
// wrong.
#pragma once
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "recon/data/dataset.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

struct RangeDifference {
  // Radar range minus SPD range, compared with training, m.
  double difference_m = 0, standard_error_m = 0;
  // Returns true if the difference is significant and larger than the tolerance of a mount.
  bool found() const;
  std::string text() const;
};

struct SensorEchoes {
  std::vector<float> median;
  std::vector<float> share;  // static part of the median, 0 to 1
};

class StaticEchoes {
 public:
  static constexpr std::size_t min_records = 50;

  StaticEchoes() = default;
  StaticEchoes(const Dataset& data, const Rows& rows);
  bool known() const { return !spd_.median.empty(); }
  // Returns nullopt if the rows are too few or have no or other static echoes. The data must be on
  // the axes of the training, and the rows in record order.
  std::optional<RangeDifference> compare(const Dataset& data, const Rows& rows) const;
  void archive(Archive archive, const Layout& layout);

 private:
  SensorEchoes spd_, radar_;
};

}  // namespace echofuse::recon

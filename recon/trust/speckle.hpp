// SPDX-License-Identifier: MIT
// Whether the radar's power varies within the records as it did in the training
// (acquire/record/speckle.hpp). Echoes that interfere where they did not, fewer independent looks
// (who hardly moves, fewer carriers) or more noise than in training leave the mean profile of a
// single record much as it was, but place it worse than the training says. Who moves less than in
// training gives fewer looks: within 150 ms the power changes less. That it changes more is no
// fault.
#pragma once
#include <array>
#include <cmath>
#include <optional>
#include <string>

#include "recon/data/dataset.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

class SpeckleReference {
 public:
  static constexpr std::size_t least_records = 50;

  SpeckleReference() = default;
  // Of the rows that show a body; without a detector (no aligned features) of all. Learns nothing
  // from fewer than least_records, as of older runs.
  SpeckleReference(const Dataset& data, const Matrix& aligned, const Rows& rows);
  bool known() const { return records_ > 0; }
  // Above 1: unusual; one in a thousand records like the training ones is. 0 if nothing is known.
  // One carrier after a training with several is unusual.
  double share(const record::Speckle& found) const;
  // Less motion than in training, which noise does not feign.
  bool less_motion(const record::Speckle& found) const;
  // "0.71 from frame to frame, 0.02 in training"
  std::string text(const record::Speckle& found) const;
  // What there is to say of a run, or nothing. The data must be on the model's axes.
  std::string of_run(const Dataset& data, const Matrix& aligned) const;

  void archive(Archive archive);

 private:
  // Logarithms: over frames, over carriers, over 150 ms.
  static constexpr std::size_t kinds = 3;
  struct Usual {
    double median = 0, most_off = 0;  // 0: not known
  };
  double share(const record::Speckle& found, std::size_t kind) const;
  std::string text(const record::Speckle& found, std::size_t kind) const;
  std::size_t clearest(const record::Speckle& found) const;
  bool hops() const;

  std::size_t records_ = 0;
  std::array<Usual, kinds> usual_;
};

}  // namespace echofuse::recon

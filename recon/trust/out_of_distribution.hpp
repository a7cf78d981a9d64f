// SPDX-License-Identifier: MIT
// Tests whether a record is out of the distribution of the training records, independent of the
// model. The flags are rows of record_numbers.hpp: no body, a saturated detector, a body outside
// the training ranges, the distance of the record's description from the training records, and the
// log odds of two bodies (learn_two_bodies). The description contains the view
// (method/alignment.hpp) and the radar profile; it does not depend on gains. The distance is the
// maximum of T^2 and of Q of each group of its values (numbers/components.hpp). About one in 250
// records like the training records exceeds a limit. Records converted from a wider radar response
// (data/response_conversion.hpp) have separate limits, learnt from imitations, because the filter
// amplifies their noise.
#pragma once
#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "recon/data/features.hpp"
#include "recon/method/alignment.hpp"
#include "recon/metrics/scene_model.hpp"
#include "recon/network/classifier.hpp"
#include "recon/numbers/limits.hpp"
#include "recon/trust/record_numbers.hpp"

namespace echofuse::recon {

// Label of records that show two people.
inline constexpr std::string_view two_people_label = "two_people";

// Learns to detect whether a record shows two bodies, from `rows` that show at most one. A small
// network separates their views from those of sums of two records, which equal records of two
// bodies if neither hides the other (outlier exposure: Hendrycks et al., ICLR 2019). With both
// sensors and a baseline, all bodies are rotated to augment the data (method/rotation.hpp). Row i
// of `views` belongs to record i. Learns nothing if fewer than two records show a body.
Classifier learn_two_bodies(const Alignment& alignment, const Features& sensors,
                            const Dataset& data, const Matrix& views, const Rows& rows,
                            const SceneModel& scene, std::uint64_t seed);

struct OutOfDistributionScore {
  // 0 at the median of the training records, 1 at the limit; two_bodies: NaN if unknown
  double distance = 0, two_bodies = 0;
  std::string reason, details;  // reason: empty if the record is in distribution
  std::string text() const { return details.empty() ? reason : reason + " (" + details + ")"; }
};

class OutOfDistributionDetector {
 public:
  static constexpr std::size_t min_records = 50;

  OutOfDistributionDetector() = default;
  // Fits the detector to at least `min_records` rows. Row i of `views` belongs to record i of
  // `data`; `views` is empty if the SPD is missing. `scene`: finds the bodies in the depth maps.
  OutOfDistributionDetector(const Alignment& alignment, const Dataset& data, const Matrix& views,
                            const Rows& rows, Inputs inputs, const SceneModel& scene,
                            std::uint64_t seed);
  // Returns one score per record. Row i of `views` belongs to rows[i] of the data.
  std::vector<OutOfDistributionScore> score(const Matrix& views, const Dataset& data,
                                            const Rows& rows) const;

  void archive(Archive archive, const Features& of_model, const Alignment& alignment);

 private:
  // Groups of the values of a description, in this order.
  enum Group : std::size_t { histogram, radar, direction, spread, range, profile, groups };
  // The last rows of record_numbers: Q of each group, T^2, and the log odds of two bodies.
  enum Number : std::size_t { t2 = groups, two, numbers };
  void use(const Features& sensors, const Alignment& alignment);
  // Sets the range limits, and returns the rows that show a body.
  Rows learn_ranges(const Matrix& descriptions);
  // Returns the descriptions of records: the view without correlation, and the normalised profile,
  // which is 0 where it may contain transmitter leakage. Row i of `views` belongs to rows[i].
  Matrix describe(const Matrix& views, const Dataset& data, const Rows& rows) const;
  Matrix describe(const Dataset& data, const Features& sensors, const Alignment& alignment) const;
  RecordValues measure(std::span<const float> description) const;

  // Index of the first value of each group, then the number of values.
  std::array<std::size_t, groups + 1> first_{};
  ComponentDistances distances_;
  Classifier two_bodies_;
  Limits limits_;
  double nearest_m_ = 0, farthest_m_ = 0, max_clicks_per_start_ = 0, share_with_body_ = 0;
};

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
// Tests whether a record is out of the distribution of the training records, independent of the
// model. The description of a record contains its histogram, its radar profile and the features of
// the radar's antennas (if the model uses them), all aligned to the range of the body
// (method/alignment.hpp). It also contains that range and the unaligned radar profile. None of
// these values depends on gains. The statistics are
//   distance    distance from the training records: the maximum of T^2 along their principal
//               components and of Q, the squared distance from the components, of each group of
//               values (Jackson and Mudholkar, Technometrics 21, 341, 1979)
//   two bodies  log odds of two bodies (learn_two_bodies); needs an SPD
// Each statistic is scaled: it is 0 at the median of the training records and 1 at its limit, so
// that a value above 1 is unusual. About one in 250 records like the training records exceeds a
// limit. Records converted from a wider radar response (data/response_conversion.hpp) have separate
// limits, learnt from imitations, because the filter amplifies their noise. Limits are interpolated
// between two widths. Further checks detect a record without a body, a body outside the training
// ranges, and a saturated detector.
#pragma once
#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "recon/data/features.hpp"
#include "recon/method/alignment.hpp"
#include "recon/metrics/scene_model.hpp"
#include "recon/network/classifier.hpp"
#include "recon/numbers/components.hpp"

namespace echofuse::recon {

// Label of records that show two people.
inline constexpr std::string_view two_people_label = "two_people";

// Learns to detect whether a record shows two bodies. The given records show at most one body.
// However, the sum of two records equals a record of two bodies if neither body hides the other
// (outlier exposure: Hendrycks et al., ICLR 2019). A small network separates views of such sums
// from views of single records. The views do not contain the correlation. A view is centred on the
// centroid of all bodies. The two bodies of a sum must have a minimum lateral distance, because
// real bodies cannot overlap. If the records have both sensors and a baseline, all bodies are
// rotated about the SPD to augment the data (method/rotation.hpp). `rows`: records with at most one
// body each; the position of the body is computed from the depth map. Learns nothing if fewer than
// two records show a body.
Classifier learn_two_bodies(const Alignment& alignment, const Features& sensors,
                            const Dataset& data, const Rows& rows, const SceneModel& scene,
                            std::uint64_t seed);

struct OutOfDistributionScore {
  // Out of distribution if either value exceeds 1; two_bodies: NaN if unknown.
  double distance = 0, two_bodies = 0;
  std::string reason;   // empty if the record is in distribution
  std::string details;  // details of the reason; may be empty
  std::string text() const { return details.empty() ? reason : reason + " (" + details + ")"; }
};

class OutOfDistributionDetector {
 public:
  static constexpr std::size_t min_records = 50;

  OutOfDistributionDetector() = default;
  // Fits the detector to these rows; at least `min_records` rows are needed. Row i of `views`
  // belongs to record i of `data`; `views` is empty if the SPD is missing. `scene` is used to find
  // the bodies in the depth maps.
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
  // Statistics of a record: Q of each group, then T^2, then the log odds of two bodies.
  enum Statistic : std::size_t { t2 = groups, two, statistics };
  struct StatisticValues {
    std::array<double, statistics> values;  // logarithms of Q and T^2, and log odds of two bodies
    Group along;                            // group that contributes most to T^2
  };
  // Limit of a statistic, learnt from records that were not used for the fit.
  struct Limit {
    double usual = 0, limit = 1;  // median of the statistic, and its limit
    double share(double value) const { return (value - usual) / (limit - usual); }
  };
  void use(const Features& sensors, const Alignment& alignment);
  using Limits = std::array<Limit, statistics>;
  struct LimitsAtWidth {
    // Measured width of the radar response divided by the width that the model expects.
    double times_wider;
    Limits limits;
  };
  void learn_components(const Matrix& descriptions, std::uint64_t seed);
  static Limits limits_of(const std::vector<StatisticValues>& held,
                          const std::vector<bool>& without_two);
  Limits limits_for(double times_wider) const;
  static void archive(Archive archive, Limits& limits);
  // Returns the description of a record: its view without correlation, and its normalised
  // profile, which is 0 where it may contain transmitter leakage.
  std::vector<float> describe(std::span<const float> view, const Dataset& data,
                              std::size_t row) const;
  // Returns true if a record shows a body; always true if the SPD is missing.
  bool shows_body(std::span<const float> description) const;
  // Returns the rows that show a body, and sets the range limits from these rows.
  Rows learn_ranges(const Matrix& descriptions);
  // Returns the descriptions of all records, one per row.
  Matrix describe_all(const Dataset& data, const Features& sensors,
                      const Alignment& alignment) const;
  StatisticValues find(std::span<const float> description) const;

  // Index of the first value of each group, followed by the number of values.
  std::array<std::size_t, groups + 1> first_{};
  std::vector<float> scale_;  // scale factor of each value of a description
  Components components_;
  Classifier two_bodies_;
  Limits limits_;
  // Limits for converted records, in order of increasing response width.
  std::vector<LimitsAtWidth> converted_;
  double nearest_m_ = 0, farthest_m_ = 0, max_clicks_per_start_ = 0, share_with_body_ = 0;
};

}  // namespace echofuse::recon

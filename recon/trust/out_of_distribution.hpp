// SPDX-License-Identifier: MIT
// Test whether a record is out of the training records' distribution, whatever the model. A record
// is described by its histogram, radar profile and view of the radar's antennas, if the model takes
// these, aligned to the body's range (method/alignment.hpp). The description also holds that range
// and the radar profile as it is. None of these depends on gains. The numbers are
//   distance    from the training records in their principal components: T^2 along the components,
//               Q of each group of values off them (Jackson and Mudholkar, Technometrics 21, 341,
//               1979), the greatest one
//   two bodies  learn_two_bodies(); it needs a detector
// Each is given as a share of its limit, so that a number above 1 is unusual. The limits are such
// that about one of 140 records like the training ones is above one of them. Records that were
// brought from a wider radar response (data/response.hpp) have limits of their own, learnt from
// imitations: the filter makes their noise larger. Between two widths they are interpolated. Beside
// these there are checks with a name: no body, a body farther or nearer than in any training
// record, a saturated detector.
#pragma once
#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "recon/data/features.hpp"
#include "recon/method/alignment.hpp"
#include "recon/metrics/scene.hpp"
#include "recon/network/classifier.hpp"
#include "recon/numbers/components.hpp"

namespace echofuse::recon {

// Label of records of two people, for whom no single body is usual.
inline constexpr std::string_view two_people_label = "two_people";

// A small network tells whether a record shows two bodies. No training record does, but the sum of
// two of them is what two bodies measure when neither hides the other (training on made-up
// outliers: Hendrycks et al., ICLR 2019). The network tells views of such sums from views of single
// records. A view is about the centroid of all that is there. The bodies of a sum stand apart
// sideways, as two bodies cannot stand in one place. With both sensors and a baseline all bodies
// are turned about the SPD (method/turned.hpp), so that few records make many. The rows have one
// body each at most; their maps tell where. The classifier takes a view without its correlation
// that shows a body. Fewer than two bodies teach nothing.
Classifier learn_two_bodies(const Alignment& alignment, const Features& sensors,
                            const Dataset& data, const Rows& rows, const Scene& scene,
                            std::uint64_t seed);

struct OutOfDistributionScore {
  double distance = 0, two_bodies = 0;  // above 1: unusual; two_bodies is NaN if it is not known
  std::string reason;                   // empty if the record is like the training ones
  std::string details;                  // details of the reason; may be empty
  std::string text() const { return details.empty() ? reason : reason + " (" + details + ")"; }
};

class OutOfDistributionDetector {
 public:
  static constexpr std::size_t least_records = 50;

  OutOfDistributionDetector() = default;
  // Learns from these rows, at least least_records. Row i of the views belongs to record i of the
  // data; without a detector there are none. The scene tells where bodies are.
  OutOfDistributionDetector(const Alignment& alignment, const Dataset& data, const Matrix& views,
                            const Rows& rows, Inputs inputs, const Scene& scene,
                            std::uint64_t seed);
  // Row i of the views belongs to rows[i] of the data.
  std::vector<OutOfDistributionScore> judge(const Matrix& views, const Dataset& data,
                                            const Rows& rows) const;

  void archive(Archive archive, const Features& of_model, const Alignment& alignment);

 private:
  // A description has these groups of values, in this order.
  enum Group : std::size_t { histogram, radar, direction, spread, range, profile, groups };
  // Each group has a Q. Behind them come T^2 and two bodies.
  enum Statistic : std::size_t { t2 = groups, two, statistics };
  struct Found {
    std::array<double, statistics> values;  // logarithms of Q and T^2; of the odds of two bodies
    Group along;                            // the group that adds most to T^2
  };
  // The limit of a statistic is set by records that took no part in the fit.
  struct Limit {
    double usual = 0, most = 1;  // the median, and the value that few records exceed
    double share(double value) const { return (value - usual) / (most - usual); }
  };
  void use(const Features& sensors, const Alignment& alignment);
  using Limits = std::array<Limit, statistics>;
  struct BroughtLimits {
    double times_wider;  // width of the response as measured over that of the model
    Limits limits;
  };
  void learn_components(const Matrix& descriptions, std::uint64_t seed);
  static Limits limits_of(const std::vector<Found>& held, const std::vector<bool>& shows_two);
  Limits limits_for(double times_wider) const;
  static void archive(Archive archive, Limits& limits);
  // A view without its correlation, and the normalised profile.
  std::vector<float> describe(std::span<const float> view, const Dataset& data,
                              std::size_t row) const;
  bool shows_body(std::span<const float> description) const;  // true without a detector
  Found find(std::span<const float> description) const;

  std::array<std::size_t, groups + 1> first_{};  // first value of each group, and the end
  std::vector<float> scale_;                     // factor of each value of a description
  Components components_;                        // components of scaled descriptions
  Classifier two_bodies_;
  Limits limits_;
  std::vector<BroughtLimits> brought_;  // narrowest first
  double nearest_m_ = 0, farthest_m_ = 0, most_clicks_per_start_ = 0, share_with_body_ = 0;
};

}  // namespace echofuse::recon

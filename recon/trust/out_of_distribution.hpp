// SPDX-License-Identifier: MIT
// This file tests whether a record is out of the training records' distribution, whatever the
// model. A record is described by its histogram, radar profile and view of the radar's antennas, if
// the model takes these, aligned to the body's range (method/alignment.hpp). The description also
// holds that range, the radar profile as it is, and how its power varied within the record
// (record_numbers.hpp). None of these depends on gains. The numbers are
//   distance    from the training records in their principal components: T^2 along the components,
//               Q of each sensor off them (Jackson and Mudholkar, Technometrics 21, 341, 1979), the
//               greatest one
//   two bodies  two_bodies.hpp
// Each is given as a share of its limit, so that a number above 1 is unusual. The limits are such
// that about one of 140 records like the training ones is above one of them. Beside these there are
// checks with a name: no body, a body farther or nearer than in any training record, a saturated
// detector.
#pragma once
#include <array>
#include <string>
#include <vector>

#include "recon/data/features.hpp"
#include "recon/method/alignment.hpp"
#include "recon/metrics/scene.hpp"
#include "recon/numbers/components.hpp"
#include "recon/trust/record_numbers.hpp"
#include "recon/trust/two_bodies.hpp"

namespace echofuse::recon {

struct OutOfDistributionScore {
  double distance = 0, two_bodies = 0;  // above 1: unusual
  std::string reason;                   // empty if the record is like the training ones
  std::string details;                  // details of the reason; may be empty
  bool may_be_two = false;              // two_bodies is above 1, and no check with a name fails
  std::string text() const { return details.empty() ? reason : reason + " (" + details + ")"; }
};

class OutOfDistributionDetector {
 public:
  static constexpr std::size_t least_records = 50;

  OutOfDistributionDetector() = default;
  // It learns from the given rows, at least least_records. A part of them only sets the limits. Row
  // i of the aligned features belongs to record i of the data; without a detector there are none.
  // The scene tells where bodies are.
  OutOfDistributionDetector(const Alignment& alignment, const Dataset& data, const Matrix& aligned,
                            const Rows& rows, Inputs inputs, const Scene& scene,
                            std::uint64_t seed);
  // Row i of the aligned features belongs to rows[i] of the data.
  std::vector<OutOfDistributionScore> judge(const Matrix& aligned, const Dataset& data,
                                            const Rows& rows) const;

  void archive(Archive archive, const Features& of_model, const Alignment& alignment);

 private:
  // This is the limit of a statistic, set by records that took no part in the fit.
  struct Limit {
    double usual = 0, most = 1;  // the median, and the value that few records exceed
    double share(double value) const { return (value - usual) / (most - usual); }
  };
  // This is a view without its correlation, which is computed from the rest.
  std::span<const float> features_of(std::span<const float> view) const {
    return view.last(std::min(view.size(), aligned_));
  }
  std::span<const float> power_of(std::span<const float> raw_inputs) const {
    return raw_inputs.subspan(spd_bins_, profile_);
  }
  // A description has these groups, in this order.
  enum Group : std::size_t { histogram, radar, direction, spread, range, profile, power, groups };
  // Returns the aligned features, the normalised profile and the variation of the power, scaled.
  std::vector<float> describe(std::span<const float> aligned, std::span<const float> radar,
                              const std::optional<record::Speckle>& speckle) const;
  void use(const Features& of_model, const Alignment& alignment);
  void learn_usual_power(const Dataset& data, const Rows& rows);
  void learn_scale(const Matrix& descriptions);
  struct Statistics {
    double t2, two_bodies;             // the logarithm of T^2; of the odds
    std::array<double, groups> along;  // what each group adds to T^2
    std::array<double, groups> q;      // logarithm of Q, of each group
  };
  Statistics statistics(std::span<const float> description, std::span<const float> aligned,
                        std::span<const float> power_profile) const;
  // How far along the components or off them, as a share of the limit, and by which group most.
  struct Distance {
    double share;
    Group group;
  };
  Distance distance(const Statistics& found) const;
  std::string power_text(const std::optional<record::Speckle>& speckle) const;
  // It learns scale and components from descriptions that are not scaled yet.
  void learn(const Matrix& descriptions, const Rows& rows, std::uint64_t seed);
  // It sets the limits from statistics of records that took no part in the fit; the limit of two
  // bodies comes from records of one person.
  void set_limits(const std::vector<Statistics>& held, const std::vector<bool>& shows_two);

  // A size is 0 without its sensor. In the raw inputs the profile starts behind spd_bins_ values.
  std::size_t aligned_ = 0, profile_ = 0, spd_bins_ = 0;
  std::array<std::size_t, groups + 1> first_{};  // first column of each group, and the end
  std::vector<double> usual_power_;              // mean logarithms of the power's variations
  std::vector<float> scale_;
  Components components_;
  Features raw_;  // layout of the raw inputs
  TwoBodies two_bodies_;
  Limit t2_, two_;
  std::array<Limit, groups> q_;
  double nearest_m_ = 0, farthest_m_ = 0, most_clicks_per_start_ = 0, share_with_body_ = 0;
};

}  // namespace echofuse::recon

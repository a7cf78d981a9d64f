// SPDX-License-Identifier: MIT
// Whether a record is out of the training records' distribution, whatever the model. A record is
// described by its histogram, radar profile and view of the radar's antennas, if the model takes
// these, aligned to the body's range (method/alignment.hpp), that range, the radar profile as it
// is, and how its power varied within the record (record_numbers.hpp); none depends on gains; then
//   distance    from the training records in their principal components: T^2 along the components,
//               Q of each sensor off them (Jackson and Mudholkar, Technometrics 21, 341, 1979), the
//               greatest one
//   two bodies  two_bodies.hpp
// Each is given as a share of its limit, so that above 1 is unusual; the limits are such that about
// one of 140 records like the training ones is above one of them. Beside these, checks with a name:
// no body, a body farther or nearer than in any training record, a saturated detector.
#pragma once
#include <array>
#include <string>
#include <vector>

#include "recon/data/features.hpp"
#include "recon/maps/scene.hpp"
#include "recon/method/alignment.hpp"
#include "recon/numbers/components.hpp"
#include "recon/trust/record_numbers.hpp"
#include "recon/trust/two_bodies.hpp"

namespace echofuse::recon {

struct OutOfDistributionScore {
  double distance = 0, two_bodies = 0;  // above 1: unusual
  std::string reason;                   // empty: like the training records
  std::string details;                  // to it, if there are any
  bool may_be_two = false;              // two_bodies is above 1, and no check with a name fails
  std::string text() const { return details.empty() ? reason : reason + " (" + details + ")"; }
};

class OutOfDistributionDetector {
 public:
  static constexpr std::size_t least_records = 50;

  OutOfDistributionDetector() = default;
  // Learns from the given rows, at least least_records. Part of them only sets the limits. Row i of
  // the aligned features is of record i of the data; without a detector there are none. The scene
  // tells where bodies are.
  OutOfDistributionDetector(const Alignment& alignment, const Dataset& data, const Matrix& aligned,
                            const Rows& rows, Inputs inputs, const Scene& scene,
                            std::uint64_t seed);
  // Row i of the aligned features belongs to rows[i] of the data.
  std::vector<OutOfDistributionScore> judge(const Matrix& aligned, const Dataset& data,
                                            const Rows& rows) const;

  void archive(Archive archive, const Features& of_model, const Alignment& alignment);

 private:
  // Of a statistic, from records that did not take part in the fit.
  struct Limit {
    double usual = 0, most = 1;  // its median; what few are above
    double share(double value) const { return (value - usual) / (most - usual); }
  };
  // A view without its correlation, which is made of the rest.
  std::span<const float> features_of(std::span<const float> view) const {
    return view.last(std::min(view.size(), aligned_));
  }
  std::span<const float> power_of(std::span<const float> raw_inputs) const {
    return raw_inputs.subspan(spd_bins_, profile_);
  }
  // What a description is made of, in this order.
  enum Group : std::size_t { histogram, radar, direction, spread, range, profile, power, groups };
  // Aligned features, normalised profile and variation of the power, scaled.
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
  // Scale and components, of descriptions that are not scaled yet.
  void learn(const Matrix& descriptions, const Rows& rows, std::uint64_t seed);
  // From statistics of records that took no part in the fit; of two bodies from those of one.
  void set_limits(const std::vector<Statistics>& held, const std::vector<bool>& shows_two);

  // 0 without the sensor. Raw inputs have the profile behind so many bins of the SPD.
  std::size_t aligned_ = 0, profile_ = 0, spd_bins_ = 0;
  std::array<std::size_t, groups + 1> first_{};  // column of each group, and behind the last
  std::vector<double> usual_power_;              // mean logarithms of its variations
  std::vector<float> scale_;
  Components components_;
  Features raw_;  // what raw inputs are made of
  TwoBodies two_bodies_;
  Limit t2_, two_;
  std::array<Limit, groups> q_;
  double nearest_m_ = 0, farthest_m_ = 0, most_clicks_per_start_ = 0, share_with_body_ = 0;
};

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
// An alignment holds the background that is learnt from the training records, and the window
// through which a body is seen. align() of the method (method.hpp) uses both.
#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "recon/method/array_view.hpp"
#include "recon/method/constants.hpp"
#include "recon/numbers/layout.hpp"
#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

// Correlation of radar profile and histogram at each shift between them. The expected profile of a
// body is its histogram, blurred by the radar's point spread. Its correlation with the profile over
// shifts has the most information on which side the body is. It is a product of both inputs that a
// small network would otherwise have to learn.
class ShiftCorrelation {
 public:
  // There are `count` points at first + i * step, in metres from the body's range.
  struct Points {
    double first_m, step_m;
    std::size_t count;
  };
  ShiftCorrelation() = default;
  // resolution_m is c/2B of the radar. The profile is shifted to longer ranges by shift_from_m to
  // shift_to_m, in metres.
  ShiftCorrelation(const Points& histogram, const Points& profile, double resolution_m,
                   double shift_from_m, double shift_to_m);

  std::size_t shifts() const { return shifts_; }
  std::size_t cost() const;  // multiply-adds
  // Computes the cosine between the profile and the profile expected from the histogram, for each
  // shift, from the longest to the shortest.
  void operator()(std::span<const float> histogram, std::span<const float> profile,
                  std::span<float> out) const;

 private:
  std::size_t shifts_ = 0;
  Matrix blur_;  // bins of the histogram x points of the expected profile
};

// Value i of a sensor lies at the slant range first_m + i * step_m. For the SPD this is the centre
// of bin i.
struct AlignmentRanges {
  double first_m, step_m;
};

inline constexpr std::ptrdiff_t profile_taps = 8;  // terms of the sinc series, on either side

// Columns of a view. T is float or const float.
template <class T>
struct ViewColumns {
  std::span<T> correlation;  // between both sensors, from the longest shift to the shortest
  std::span<T> histogram;    // shares of the counts about the range
  std::span<T> zones;        // the same of each zone, in wider bins; shares of the counts of all
  std::span<T> profile;      // shares of the power
  std::span<T> antennas;     // array_view.hpp
  T& range_m;                // 0 means that nobody is there
};
using AlignmentColumns = ViewColumns<float>;

// True if a view, whole or from its histogram on, shows a body.
inline bool shows_body(std::span<const float> view) { return view.back() != 0; }

// Threading: a const object may be shared.
class Alignment {
 public:
  Alignment() = default;
  // Learns the background from observations (counts, power, lags: method.hpp). Without a radar the
  // profile has no points. Throws Error(usage) without a histogram.
  Alignment(const Layout& layout, const Matrix& observations, const Rows& rows);

  bool known() const { return !counts_background_.empty(); }
  std::size_t cost() const;  // multiply-adds of one record
  AlignmentRanges spd_ranges() const { return {spd_first_m_, spd_step_m_}; }
  double resolution_m() const;  // c/2B of the radar

  std::size_t histogram_bins() const;
  std::size_t zone_bins() const;  // wider ones, in each zone
  std::size_t zone_features() const { return zones_ * zone_bins(); }
  std::size_t profile_points() const;                           // 0 without a radar
  std::size_t array_features() const { return array_.size(); }  // 0 without its antennas
  // Numbers of values of a view, without and with the correlation, which comes first.
  std::size_t size() const {
    return histogram_bins() + zone_features() + profile_points() + array_features() + 1;
  }
  std::size_t inputs() const { return correlation_.shifts() + size(); }
  AlignmentColumns columns(std::span<float> view) const { return columns_of<float>(view); }
  ViewColumns<const float> columns(std::span<const float> view) const {
    return columns_of<const float>(view);
  }

  // Equation (1): it gives the counts less their background, and the power above its background.
  void subtract_background(std::span<const float> observation, std::vector<float>& counts,
                           std::vector<float>& power) const;
  // Returns the same counts of each zone, one a row.
  Matrix zone_counts(std::span<const float> observation) const;
  // Equation (4): it takes the power above the background. The shares add up to 1. `points` are all
  // points of the view.
  void profile_about(double range_m, std::span<const float> power, std::span<float> points) const;
  // Equation (6): it correlates columns of a view.
  void correlate(std::span<const float> histogram, std::span<const float> profile,
                 std::span<float> out) const;
  // Equation (7): it takes the lags as they were recorded. Without lags the features are as if the
  // antennas saw nothing.
  void antennas_about(double range_m, std::span<const float> lags, std::span<float> out) const;

  // Writes into a view the profile of the same record as if the radar saw the body farther away by
  // `farther_m`. Used for rotation augmentation (turned.hpp).
  void move_profile(std::span<const float> recorded_power, double farther_m,
                    std::span<float> view) const;
  // Same for the antennas' features, in a direction whose cosine is larger by `by_cosine`.
  void move_array(std::span<const float> recorded_lags, double farther_m, double by_cosine,
                  std::span<float> view) const;
  // Writes into a view the sum of profiles, each moved to longer ranges. The correlation is
  // unchanged.
  struct MovedProfile {
    std::span<const float> recorded_power;
    double farther_m;
  };
  void add_profiles(std::span<const MovedProfile> profiles, std::span<float> view) const;
  // Displacement of the radar's range against the body's, in metres: the centroid of the squared
  // profile, because noise and side lobes hardly move it.
  double displacement_m(std::span<const float> view) const;

  // Background in the layout of an observation. Setting it from an empty room replaces learning it.
  std::vector<float> background() const;
  void set_background(std::span<const float> observation);

  void archive(Archive archive, const Layout& layout);

 private:
  template <class T>
  ViewColumns<T> columns_of(std::span<T> view) const {
    const auto features = view.last(size());
    const std::size_t bins = histogram_bins(), points = profile_points();
    const auto of_radar = features.subspan(bins + zone_features());
    return {view.first(view.size() - features.size()),  features.first(bins),
            features.subspan(bins, zone_features()),    of_radar.first(points),
            of_radar.subspan(points, array_features()), view.back()};
  }
  void set_axes(const Layout& layout);
  std::vector<float> above_background(std::span<const float> recorded_power) const;
  void add_profile(double range_m, std::span<const float> power, std::span<float> points) const;
  void learn_array_background(const Matrix& observations, const Rows& rows);
  std::size_t points_with_radar() const;

  double spd_first_m_ = 0, spd_step_m_ = 1, radar_first_m_ = 0, radar_step_m_ = 1;
  double profile_step_m_ = 1;
  // Ratio of the radar's steps to the profile's points: one of the two is 1.
  std::ptrdiff_t points_a_step_ = 1, steps_a_point_ = 1;
  ShiftCorrelation correlation_;
  ArrayView array_;
  std::size_t lag_values_ = 1, zones_ = 0;
  std::vector<float> counts_background_, power_background_, lags_background_, zones_background_;
};

}  // namespace echofuse::recon

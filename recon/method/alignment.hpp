// SPDX-License-Identifier: MIT
// Alignment: the background learnt from the training records, and the window about a body's range.
// Used by align() of the method (method.hpp).
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

// Correlation of radar profile and histogram for each shift between them. The expected profile of a
// body is its histogram, blurred by the radar's point spread. Its correlation with the profile
// contains most of the information about the body's side. It is a product of both inputs, which a
// small network would otherwise have to learn.
class ShiftCorrelation {
 public:
  // `count` points at first_m + i * step_m, m from the body's range.
  struct Points {
    double first_m, step_m;
    std::size_t count;
  };
  ShiftCorrelation() = default;
  // resolution_m: c/2B of the radar. The profile is shifted to longer ranges by shift_from_m to
  // shift_to_m, m.
  ShiftCorrelation(const Points& histogram, const Points& profile, double resolution_m,
                   double shift_from_m, double shift_to_m);

  std::size_t shifts() const { return shifts_; }
  std::size_t cost() const;  // multiply-adds
  // Computes the cosine similarity between the profile and that expected from the histogram, for
  // each shift, from the longest to the shortest.
  void operator()(std::span<const float> histogram, std::span<const float> profile,
                  std::span<float> out) const;

 private:
  std::size_t shifts_ = 0;
  Matrix blur_;  // histogram bins x points of the expected profile
};

// Value i of a sensor is at slant range first_m + i * step_m. For the SPD this is the centre of bin
// i.
struct AlignmentRanges {
  double first_m, step_m;
};

inline constexpr std::ptrdiff_t profile_taps = 8;  // terms of the sinc series on each side

// Columns of a view. T is float or const float.
template <class T>
struct ViewColumns {
  std::span<T> correlation;  // between both sensors, from the longest to the shortest shift
  std::span<T> histogram;    // shares of the counts about the range
  std::span<T> zones;        // same for each zone in wider bins; shares of the total counts
  std::span<T> profile;      // shares of the power
  std::span<T> antennas;     // described in array_view.hpp
  T& range_m;                // 0: no body
};
using AlignmentColumns = ViewColumns<float>;

// Returns true if a view, complete or from its histogram on, shows a body.
inline bool shows_body(std::span<const float> view) { return view.back() != 0; }

// Threading: a const object may be shared.
class Alignment {
 public:
  Alignment() = default;
  // Learns the background from observations (counts, power, lags: method.hpp). The profile is empty
  // without a radar. Throws Error(usage) without a histogram.
  Alignment(const Layout& layout, const Matrix& observations, const Rows& rows);

  bool known() const { return !counts_background_.empty(); }
  std::size_t cost() const;  // multiply-adds per record
  AlignmentRanges spd_ranges() const { return {spd_first_m_, spd_step_m_}; }
  double resolution_m() const;  // c/2B of the radar

  std::size_t histogram_bins() const;
  std::size_t zone_bins() const;  // wider bins, per zone
  std::size_t zone_features() const { return zones_ * zone_bins(); }
  std::size_t profile_points() const;                           // 0 without a radar
  std::size_t array_features() const { return array_.size(); }  // 0 without antennas
  // Number of values of a view, without and with the correlation, which comes first.
  std::size_t size() const {
    return histogram_bins() + zone_features() + profile_points() + array_features() + 1;
  }
  std::size_t inputs() const { return correlation_.shifts() + size(); }
  AlignmentColumns columns(std::span<float> view) const { return columns_of<float>(view); }
  ViewColumns<const float> columns(std::span<const float> view) const {
    return columns_of<const float>(view);
  }

  // Equation (1): writes the counts minus their background, and the power minus its background.
  void subtract_background(std::span<const float> observation, std::vector<float>& counts,
                           std::vector<float>& power) const;
  // Returns these counts for each zone, one zone per row.
  Matrix zone_counts(std::span<const float> observation) const;
  // Equation (4), for power above the background. The shares add up to 1. `points`: all points of
  // the view.
  void profile_about(double range_m, std::span<const float> power, std::span<float> points) const;
  // Equation (6), for the columns of a view.
  void correlate(std::span<const float> histogram, std::span<const float> profile,
                 std::span<float> out) const;
  // Equation (7), for lags as recorded. Without lags the features are those of zero signal.
  void antennas_about(double range_m, std::span<const float> lags, std::span<float> out) const;

  // Replaces the profile in a view of the same record, as if the body were `farther_m` farther from
  // the radar. Used for rotation augmentation (rotation.hpp).
  void move_profile(std::span<const float> recorded_power, double farther_m,
                    std::span<float> view) const;
  // Same for the antennas' features; the direction cosine increases by `by_cosine`.
  void move_array(std::span<const float> recorded_lags, double farther_m, double by_cosine,
                  std::span<float> view) const;
  // Replaces the profile in a view by a sum of profiles, each shifted to longer ranges. Does not
  // change the correlation.
  struct MovedProfile {
    std::span<const float> recorded_power;
    double farther_m;
  };
  void add_profiles(std::span<const MovedProfile> profiles, std::span<float> view) const;
  // Returns the radar's range minus the body's range, m: centroid of the squared profile, because
  // noise and side lobes hardly affect it.
  double displacement_m(std::span<const float> view) const;

  // Background in the layout of an observation. Setting that of an empty room replaces the learnt
  // one.
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
  // Radar steps per profile point, or points per step; one of the two is 1.
  std::ptrdiff_t points_a_step_ = 1, steps_a_point_ = 1;
  ShiftCorrelation correlation_;
  ArrayView array_;
  std::size_t lag_values_ = 1, zones_ = 0;
  std::vector<float> counts_background_, power_background_, lags_background_, zones_background_;
};

}  // namespace echofuse::recon

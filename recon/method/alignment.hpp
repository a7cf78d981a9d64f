// SPDX-License-Identifier: MIT
// Alignment: the background learnt from the training records, and the window around the range of a
// body. Used by align() of the method (method.hpp).
#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "recon/data/column.hpp"
#include "recon/method/array_view.hpp"
#include "recon/method/constants.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

// Correlation between the radar profile and the profile expected from the histogram, as a function
// of their relative shift in range. The expected profile of a body is its histogram convolved with
// the radar's point spread function. The correlation contains most of the information on whether
// the body is on the left or the right. Without it, a small network would have to learn this
// product of the two inputs.
class ShiftCorrelation {
 public:
  // Points at first_m + i * step_m for i < count, in metres relative to the range of the body.
  struct Points {
    double first_m, step_m;
    std::size_t count;
  };
  ShiftCorrelation() = default;
  // resolution_m: range resolution c/2B of the radar. shift_from_m, shift_to_m: smallest and
  // largest shift of the profile to longer ranges, m.
  ShiftCorrelation(const Points& histogram, const Points& profile, double resolution_m,
                   double shift_from_m, double shift_to_m);

  std::size_t shifts() const { return shifts_; }
  std::size_t cost() const;  // number of multiply-adds per record
  // Computes the cosine similarity between the measured profile and the profile expected from the
  // histogram, for each shift, from the largest to the smallest.
  void operator()(std::span<const float> histogram, std::span<const float> profile,
                  std::span<float> out) const;

 private:
  std::size_t shifts_ = 0;
  // Radar response to each histogram bin: [histogram bins x points of the expected profile].
  Matrix blur_;
};

// Slant ranges of a sensor: value i is at range first_m + i * step_m. For the SPD, this range is
// the centre of bin i.
struct AlignmentRanges {
  double first_m, step_m;
};

// Number of terms of the sinc series on each side of the interpolated point.
inline constexpr std::ptrdiff_t profile_taps = 8;

// Groups of columns of a view. T is float or const float.
template <class T>
struct ViewColumns {
  // Correlation of profile and histogram, from the largest to the smallest shift.
  std::span<T> correlation;
  std::span<T> histogram;  // counts around the range of the body, divided by their sum
  // Histogram of each zone in wider bins, as fractions of the counts of all zones.
  std::span<T> zones;
  std::span<T> profile;   // powers around the range of the body, divided by their sum
  std::span<T> antennas;  // features of the antennas (array_view.hpp)
  T& range_m;             // range of the body; 0: no body
};
using AlignmentColumns = ViewColumns<float>;

// Returns true if a view shows a body. The view may lack the correlation columns.
inline bool shows_body(std::span<const float> view) { return view.back() != 0; }

// Aligns records to the range of the body. Threading: several threads may use a const object.
class Alignment {
 public:
  Alignment() = default;
  // Learns the background from observations, which contain counts, power and lags (method.hpp). If
  // the observations do not include the radar, views have no profile. Throws Error(usage) if the
  // histogram is missing.
  Alignment(const Layout& layout, const Matrix& observations, const Rows& rows);

  bool known() const { return !background_.empty(); }
  std::size_t cost() const;  // number of multiply-adds per record
  AlignmentRanges spd_ranges() const { return {spd_first_m_, spd_step_m_}; }
  double resolution_m() const;  // range resolution c/2B of the radar

  std::size_t histogram_bins() const;
  std::size_t zone_bins() const;  // number of bins per zone
  std::size_t zone_features() const {
    return layout_.zones_size() > 0 ? layout_.spd.zones.size() * zone_bins() : 0;
  }
  std::size_t profile_points() const;  // number of points of a profile; 0 if the radar is missing
  // Returns true if a view can be computed for a body at another azimuth. Zones would see it in
  // other directions.
  bool turns_bodies() const { return profile_points() > 0 && zone_features() == 0; }
  std::size_t array_features() const { return array_.size(); }  // 0 if there are no antennas
  // size(): number of values in a view, excluding the correlation. inputs(): number including the
  // correlation, which comes first.
  std::size_t size() const {
    return histogram_bins() + zone_features() + profile_points() + array_features() + 1;
  }
  std::size_t inputs() const { return correlation_.shifts() + size(); }
  // Returns the index of the first value of each group of a view without the correlation, then its
  // size: histogram and zones, profile, direction and spread of the antennas, range.
  std::array<std::size_t, 6> groups() const {
    const std::size_t profile = histogram_bins() + zone_features(),
                      antennas = profile + profile_points();
    return {0,          profile,
            antennas,   antennas + std::min(array_features(), ArrayView::of_direction),
            size() - 1, size()};
  }
  AlignmentColumns columns(std::span<float> view) const { return columns_of<float>(view); }
  ViewColumns<const float> columns(std::span<const float> view) const {
    return columns_of<const float>(view);
  }

  ObservationParts<const float> parts(std::span<const float> observation) const {
    return layout_.parts(observation);
  }

  // Equation (1) of method.cpp: writes the counts minus the background and the median, and the
  // power minus the background.
  void subtract_background(std::span<const float> observation, std::vector<float>& counts,
                           std::vector<float>& power) const;
  // Returns the counts of each zone minus the background and the median, one zone per row.
  Matrix zone_counts(std::span<const float> observation) const;
  // Equation (4) of method.cpp, for power above the background: writes all points of a view's
  // profile, scaled to a sum of 1.
  void profile_about(double range_m, std::span<const float> power, std::span<float> points) const;
  // Equation (6) of method.cpp: writes the correlation of a view.
  void correlate(std::span<const float> histogram, std::span<const float> profile,
                 std::span<float> out) const;
  // Equation (7) of method.cpp: computes the antenna features of a view from the recorded lags. If
  // there are no lags, writes the features of a zero signal.
  void antennas_about(double range_m, std::span<const float> lags, std::span<float> out) const;

  // Replaces the profile and the correlation in the view of a record, as if its body were
  // `farther_m` farther from the radar. recorded_power: power of the same record. Used for rotation
  // augmentation (rotation.hpp).
  void move_profile(std::span<const float> recorded_power, double farther_m,
                    std::span<float> view) const;
  // Replaces the antenna features in the view of a record, as if its body were `farther_m` farther
  // from the radar and its direction cosine were larger by `by_cosine`.
  void move_array(std::span<const float> recorded_lags, double farther_m, double by_cosine,
                  std::span<float> view) const;
  // add_profiles() replaces the profile in a view with the sum of these profiles, each shifted to
  // longer ranges by farther_m. It does not change the correlation.
  struct MovedProfile {
    std::span<const float> recorded_power;
    double farther_m;
  };
  void add_profiles(std::span<const MovedProfile> profiles, std::span<float> view) const;
  // Returns the range of the radar echo minus the range of the body, m. The radar range is the
  // centroid of the squared profile, because noise and side lobes hardly affect it.
  double displacement_m(std::span<const float> view) const;

  // background() returns the background in the layout of an observation. set_background() replaces
  // the learnt background, e.g. with that of an empty room.
  const std::vector<float>& background() const { return background_; }
  void set_background(std::vector<float> observation) { background_ = std::move(observation); }

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

  double spd_first_m_ = 0, spd_step_m_ = 1, radar_first_m_ = 0, radar_step_m_ = 1;
  double profile_step_m_ = 1;
  // Profile points per radar step, and radar steps per profile point; at least one of these ratios
  // is 1.
  std::ptrdiff_t points_a_step_ = 1, steps_a_point_ = 1;
  ShiftCorrelation correlation_;
  ArrayView array_;
  Layout layout_;
  std::vector<float> background_;  // an observation of the room without people
};

}  // namespace echofuse::recon

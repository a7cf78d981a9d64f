// SPDX-License-Identifier: MIT
// A record as seen from the body in it: the SPD's histogram and the radar's profile around the
// range at which the SPD sees the body. What tells left from right is the radar profile's shift
// against the histogram, dR = b x / r, and that stands out once both are aligned to one of them.
// Each sensor is divided by its own sum, so that laser power, exposure and gains do not matter;
// where gains are stable, how strong the two are against each other is kept beside
// (brightness.hpp). What the radar's antennas see, if a run has it, is aligned to the same range
// (array_view.hpp).
#pragma once
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/record/h5.hpp"
#include "recon/models/body/array_view.hpp"
#include "recon/models/body/brightness.hpp"
#include "recon/models/body/shift_correlation.hpp"
#include "recon/numbers/layout.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

// Slant range of a sensor's values: first + i * step. Of the SPD: of its bins' centres.
struct AlignmentRanges {
  double first_m, step_m;
};

inline constexpr std::ptrdiff_t profile_taps = 8;  // of the sinc series, on either side

struct Body {
  // More clicks above the background than five standard deviations of all clicks.
  bool detected = false;
  float range_m = 0;  // slant range of the histogram's centroid
};

// How far about the body's range is looked, metres.
struct AlignmentWindow {
  double histogram_m = 0.7;  // on either side
  double profile_from_m = -0.8,
         profile_to_m = 1.1;  // of the radar: a target at x shifts it by b x / r
  double body_m = 0.8;        // for its centroid: half the depth of a body with outstretched arms
};

// Aligned features, one row a record. Where nobody is, all of a row is zero.
inline bool shows_body(std::span<const float> features) { return features.back() != 0; }

// Threading: as a const object may be shared.
class Alignment {
 public:
  Alignment() = default;
  // Learns from raw inputs (clicks per bin, radar power per bin, lags per bin) what is always
  // there. Without a radar the profile has no points. Throws Error(usage) without a histogram.
  Alignment(const Layout& layout, const Matrix& raw_inputs, const Rows& rows,
            Gains gains = Gains::unknown);

  // The same background, seen through another window, whatever the gains.
  Alignment through(const AlignmentWindow& window) const;

  bool known() const { return !spd_background_.empty(); }
  Gains gains() const { return brightness_ ? Gains::stable : Gains::unknown; }
  // Of stable gains: what brightness is usual at a range, of records in which bodies are.
  void learn_brightness(const Matrix& raw_inputs, const Rows& rows);
  std::size_t cost() const;  // multiply-adds of one record
  AlignmentRanges spd_ranges() const { return {spd_first_m_, spd_step_m_}; }
  AlignmentRanges radar_ranges() const { return {radar_first_m_, radar_step_m_}; }
  double resolution_m() const;  // of the radar, c/2B
  // Clicks and power above what is always there; the median of the clicks is 0.
  void subtract_background(std::span<const float> raw_inputs, std::vector<float>& clicks,
                           std::vector<float>& power) const;
  std::size_t histogram_bins() const;
  std::size_t profile_points() const;                           // 0 without a radar
  std::size_t array_features() const { return array_.size(); }  // 0 without its antennas
  std::size_t brightness_features() const { return brightness_ ? Brightness::features : 0; }
  std::size_t size() const {
    return histogram_bins() + profile_points() + array_features() + brightness_features() + 1;
  }
  // Fills size() features: histogram (shares of the clicks), profile (shares of the power), view of
  // the antennas (ArrayView), brightness, range. All zero if there is no body; the range, which
  // comes last, never is if there is one. Raw inputs without lags: as if the antennas saw nothing.
  Body operator()(std::span<const float> raw_inputs, std::span<float> features) const;
  Matrix operator()(const Matrix& raw_inputs) const;  // the features of every row
  // What models take: [correlations ++ features] of every row of features. The correlations are all
  // zero if there is no body.
  std::size_t inputs() const { return correlation_.shifts() + size(); }
  Matrix with_correlations(const Matrix& aligned) const;
  // Puts into such a row of a body the same record's profile, moved to longer ranges, so many times
  // as strong.
  void move_profile(std::span<const float> raw_power, double farther_m, double times,
                    std::span<float> inputs) const;
  // Puts into features of a body the sum of profiles, each moved to longer ranges.
  struct MovedProfile {
    std::span<const float> raw_power;
    double farther_m;
  };
  void add_profiles(std::span<const MovedProfile> profiles, std::span<float> features) const;
  // Of features, or inputs; empty unless gains are stable.
  template <class T>
  std::span<T> brightness_of(std::span<T> features) const {
    return features.last(brightness_features() + 1).first(brightness_features());
  }
  // Puts into it what the record's antennas saw there, in a direction whose cosine is so much more.
  void move_array(std::span<const float> raw_lags, double farther_m, double by_cosine,
                  std::span<float> inputs) const;
  // The direction cosine in which the antennas see the body, of features with one.
  double direction_cosine(std::span<const float> features) const;
  // How far behind the body's range the radar sees it, metres, of features with a body: the
  // centroid of the squared profile, which noise and side lobes hardly pull.
  double displacement_m(std::span<const float> features) const;
  // The lags that are always there; all zero without antennas.
  const std::vector<float>& array_background() const { return array_background_; }
  // What is always there, as raw inputs have it; set from an empty room, it needs no learning.
  std::vector<float> background() const;
  void set_background(std::span<const float> raw_inputs);
  // How much of the radar's power comes from what is always there.
  double radar_background_share(const Matrix& powers, const Rows& rows) const;

  void save(record::H5File& file) const;  // below "alignment/"
  void load(const record::H5File& file, const Layout& layout);

 private:
  void set_axes(const Layout& layout);
  void set_window(const AlignmentWindow& window);
  Body find_body(std::span<const float> clicks, std::span<const float> counts) const;
  // Both return what they divide by.
  float align_histogram(std::span<const float> clicks, float range_m, std::span<float> out) const;
  std::vector<float> above_background(std::span<const float> raw_power) const;
  float align_profile(std::span<const float> power, double range_m, std::span<float> out) const;
  void add_profile(std::span<const float> power, double range_m, std::span<float> out) const;
  void correlate(std::span<float> inputs) const;
  // Of features that end with the range.
  template <class T>
  std::span<T> array_of(std::span<T> features) const {
    return features.last(array_features() + brightness_features() + 1).first(array_features());
  }
  void view(std::span<const float> raw_lags, double range_m, std::span<float> out) const;
  void learn_array_background(const Matrix& raw_inputs, const Rows& rows);
  std::size_t points_with_radar() const;

  AlignmentWindow window_;
  // Slant range of a point of each axis: first + i * step. Of the SPD: of the bins' centres.
  double spd_first_m_ = 0, spd_step_m_ = 1, radar_first_m_ = 0, radar_step_m_ = 1;
  double profile_step_m_ = 1;
  // Of the radar's steps and the profile's points: one of them is 1.
  std::ptrdiff_t points_a_step_ = 1, steps_a_point_ = 1;
  ShiftCorrelation correlation_;
  ArrayView array_;
  std::optional<Brightness> brightness_;  // of stable gains
  std::size_t lag_values_ = 1;
  std::vector<float> spd_background_, radar_background_, array_background_;
};

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
// What the radar's virtual antennas receive, frame by frame and carrier by carrier:
//   x_m = gain_m exp(i phase_m) sum_k a_k psf(R - R_k) exp(i pi (x_m u_k + y_m v_k)) + noise
// with places x, y in half wavelengths and direction cosines u (right) and v (up). In units in
// which the mean scene as a single point has power 1 (radar_power).
//   coherent    Every cell of range, direction and height has an amplitude of its own, complex
//               Gaussian (fully developed speckle), and its phase turns by 4 pi / wavelength times
//               the way that sway, twist and breath take it (body_motion.hpp). The room and objects
//               stand still: their phases belong to the seed, and the mean of all frames is theirs.
//               At another carrier, df higher, what is at range R has a phase 4 pi R df / c less:
//               the speckle of a body of depth L is another one from c / 2L on (Goodman, Speckle
//               Phenomena in Optics, 2007, 5.3). Antennas stand in half wavelengths of each
//               carrier.
//   incoherent  As if there were infinitely many looks: over any radar_frames successive frames (of
//               each carrier) the covariance is exactly sum_k w_k psf^2 a a^H. Successive ones are
//               uncorrelated.
// Leakage and the calibration reflector are points that stand still. What moves at v m/s while the
// transmitters send in turn, chirp_s apart and `chirps` times each, has at transmitter t of T
//   exp(-4 pi i v t chirp_s / wavelength) sin(pi f C) / (C sin(pi f)),
// with C = chirps, f = 2 v T chirp_s / wavelength (Doppler bin 0).
#pragma once
#include <complex>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "acquire/record/radar_array.hpp"
#include "acquire/record/speckle.hpp"
#include "drivers/core/random.hpp"
#include "sim/scene/conditions.hpp"
#include "sim/scene/radar_axis.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {

// Places: up to 8 in a row; 12: transmitters (0,0) (2,2) (0,2) with receivers (1,1) (1,0) (0,1)
// (0,0) each, as on TI's IWR6843AOP.
record::Antennas antennas_in_layout(std::size_t count);
// The same with errors of phase and gain, radar_phase_error_rad and radar_gain_error_db, drawn from
// the seed.
record::Antennas simulated_antennas(const Conditions& conditions, std::uint64_t seed);
// As the run says they are: with their errors if radar_array_calibrated.
record::Antennas stated_antennas(const record::Antennas& antennas, const Conditions& conditions);

// What the records of a run have in common. The still seed is the room's.
struct ArrayRadar {
  RadarAxis axis;
  record::Antennas antennas;
  std::uint64_t still_seed = 0;
  // Antennas of one transmitter follow one another. It sends `chirps` times in a frame, chirp_s
  // after the one before it; 0: all at once.
  std::size_t receivers = 4;
  double chirp_s = 0;
  std::int64_t chirps = 1;
  // room_echo(), where the room is subtracted from the returns (render.hpp); else empty.
  std::span<const float> room{};
  // Above the first one (carriers_hz).
  std::vector<double> carriers_hz{0};
};

// Of radar_warming_k after this time: each antenna's phase.
std::vector<double> antenna_drift(const Conditions& conditions, std::size_t antennas,
                                  std::uint64_t seed, double time_s);

class ArrayEcho {
 public:
  ArrayEcho(const Returns& returns, const ArrayRadar& radar, const Conditions& conditions,
            Rng& rng);
  ~ArrayEcho();
  ArrayEcho(ArrayEcho&&) noexcept;
  ArrayEcho& operator=(ArrayEcho&&) noexcept;

  std::size_t samples() const;
  // Points of the axis times antennas, antennas fastest, without noise, so long after the former
  // frame.
  void frame(double later_s, Rng& rng, std::span<std::complex<float>> samples);

  // The next frame is of this one of ArrayRadar::carriers_hz; the first of all, unless said.
  void set_carrier(std::size_t carrier);
  // From now on the antennas' phases are ahead by this (rad; as many as there are antennas).
  void set_drift(std::span<const double> phases);

  // The same in two steps: how everything stands in the frame, as state_size() numbers, and the
  // samples of each block of `lanes` points. Those are planes: for each antenna `lanes` real parts,
  // from imaginary_plane() on as many imaginary ones; planes_size() numbers.
  std::size_t state_size() const;
  void advance(double later_s, Rng& rng, std::span<float> state);
  std::size_t blocks() const;
  std::size_t planes_size() const;
  std::size_t imaginary_plane() const;
  void look(std::size_t block, std::span<const float> state, std::span<float> planes) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

// Of the room alone, coherent, at each carrier (ArrayRadar::room).
std::vector<float> room_echo(const ArrayRadar& radar, const Conditions& conditions);

// A record's: radar_frames frames over dataset_window_s, each of all carriers, with noise of this
// power in each sample.
struct ArrayLooks {
  std::vector<float> array;   // of the first `kept_bins` points (ArrayStatistics)
  std::vector<double> power;  // of each point, mean over frames, carriers and antennas
  std::optional<record::Speckle> speckle;
};
ArrayLooks look_through_array(const Returns& returns, const ArrayRadar& radar,
                              std::size_t kept_bins, const Conditions& conditions,
                              double noise_power, Rng& rng, std::span<const double> drift = {});

}  // namespace echofuse::sim

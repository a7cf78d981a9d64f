// SPDX-License-Identifier: MIT
// The radar's virtual antennas receive, frame by frame:
//   x_m = gain_m exp(i phase_m) sum_k a_k psf(R - R_k) exp(i pi (x_m u_k + y_m v_k)) + noise
// with places x, y in half wavelengths and direction cosines u (right) and v (up). Power is in
// units in which the mean scene as a single point has power 1 (radar_power).
//   coherent    Every cell of range, direction and height has an amplitude of its own, complex
//               Gaussian (fully developed speckle), and its phase turns by 4 pi / wavelength times
//               the way that sway, twist and breath take it (BodyMotion). The room and objects
//               stand still: their phases belong to the seed, and the mean of all frames is theirs.
//   incoherent  As if there were infinitely many looks: over any radar_frames successive frames
//               the covariance is exactly sum_k w_k psf^2 a a^H. Successive ones are uncorrelated.
// Leakage and the calibration reflector are points that stand still. The reflector is near: with
// the places of transmitters t and receivers r its phase is
//   -2 pi (|P - t| + |P - r| - 2 |P|) / wavelength. The transmitters send in turn,
// chirp_s apart and `chirps` times each. An echo that moves at v m/s has at transmitter t of T
//   exp(-4 pi i v t chirp_s / wavelength) sin(pi f C) / (C sin(pi f)),
// with C = chirps, f = 2 v T chirp_s / wavelength (Doppler bin 0).
// The response psf is that to the middle of an eighth of a resolution cell.
#pragma once
#include <array>
#include <complex>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "acquire/measurement/radar_array.hpp"
#include "drivers/core/random.hpp"
#include "sim/scene/conditions.hpp"
#include "sim/scene/radar_axis.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {

// Places of up to 8 antennas in a row. With 12, transmitters (0,0) (2,2) (0,2) have receivers (1,1)
// (1,0) (0,1) (0,0) each, as on TI's IWR6843AOP.
record::Antennas antennas_in_layout(std::size_t count);
// Returns antennas with random errors of phase and gain (radar_phase_error_rad,
// radar_gain_error_db), drawn from the seed.
record::Antennas simulated_antennas(const Conditions& conditions, std::uint64_t seed);
// Returns the antennas for the run file; with the simulated errors if radar_array_calibrated.
record::Antennas stated_antennas(const record::Antennas& antennas, const Conditions& conditions);

// Motion of standing people. They sway about their ankles as an inverted pendulum (Morasso et al.,
// PLoS ONE 14, e0213870, 2019), by some millimetres at the centre of pressure (Prieto et al., IEEE
// Trans. Biomed. Eng. 43, 956, 1996), twist about an upright axis and breathe. At 60 GHz 2.5 mm
// turn the echo's phase by 360 degrees.
class BodyMotion {
 public:
  // Modes: sway to the right and away from the radar (m, at head height), twist (rad), breath (m).
  static constexpr std::size_t modes = 4;
  using Modes = std::array<float, modes>;

  // Each person's motion is random and stationary from the start. Sway and twist are critically
  // damped oscillators driven by white noise, with covariance (1 + wt) exp(-wt) and w = 2 per
  // second: the head moves at about 1 cm/s. Breath is a sine of 0.25 Hz.
  BodyMotion(const Conditions& conditions, std::size_t people, Rng& rng);
  void advance(double time_s, Rng& rng);
  // Displacement in each mode, one entry per person.
  const std::vector<Modes>& places() const { return places_; }
  const std::vector<Modes>& speeds() const { return speeds_; }  // per second

  // Change of a patch's range (m) per unit of each mode. x, y: direction cosines x/R and y/R;
  // height above the floor; place of the person's axis (m, from the radar).
  static Modes range_per_mode(double x, double y, double height_m, double axis_x_m, double axis_z_m,
                              double body_scale);

 private:
  struct Oscillator {
    double place = 0, speed = 0;  // unit variance; speed in units of w
  };
  void set_modes();

  static constexpr std::size_t swaying = 3;
  std::array<double, swaying> rms_;
  double breath_m_, time_s_ = 0;
  std::vector<std::array<Oscillator, swaying>> oscillators_;
  std::vector<double> breath_phase_;
  std::vector<Modes> places_, speeds_;
};

// Sum of patches that the antennas cannot resolve: summed weight, centre of all other values. The
// phase of eight antennas changes by 0.7 rad across a cell (0.03 in direction cosine). The phase of
// a head that sways 5 mm also changes by 0.7 rad across a cell (0.1 m in height).
struct EchoCell {
  double weight = 0, range_m = 0, x = 0, y = 0, height_m = 0;
  std::int32_t person = Returns::still;
};
struct EchoCells {
  std::vector<EchoCell> cells;       // sorted by slot of range
  std::vector<std::size_t> begin;    // first cell of each slot, and the end
  std::vector<double> slot_range_m;  // mean range of the patches in each slot
  std::size_t people = 0;
};
EchoCells echo_cells(const Returns& returns, double slot_m, bool with_room);
// Adds up all patches of one kind (Returns::reflector, leakage); weight 0: no such patch.
EchoCell cell_of_kind(const Returns& returns, std::int32_t kind);

// Common to all records of a run. The still seed is that of the room.
struct AntennaRadar {
  RadarAxis axis;
  record::Antennas antennas;
  std::uint64_t still_seed = 0;
  // Antennas of one transmitter are adjacent. Transmitters send in turn, chirp_s apart, `chirps`
  // times per frame; chirp_s = 0: all at once.
  std::size_t receivers = 4;
  double chirp_s = 0;
  std::int64_t chirps = 1;
  // Result of room_echo() if the room is subtracted from the returns (render.hpp); otherwise empty.
  std::span<const std::complex<float>> room{};
  // Transmitter and receiver of each antenna, m from the centre of either group, and the
  // wavelength; empty: the reflector's wave is plane.
  struct TxRxPair {
    double tx_x = 0, tx_y = 0, rx_x = 0, rx_y = 0;
  };
  std::vector<TxRxPair> pairs{};
  double wavelength_m = 0;
};

class AntennaEcho {
 public:
  AntennaEcho(const Returns& returns, const AntennaRadar& radar, const Conditions& conditions,
              Rng& rng);
  ~AntennaEcho();
  AntennaEcho(AntennaEcho&&) noexcept;
  AntennaEcho& operator=(AntennaEcho&&) noexcept;

  std::size_t samples() const { return points_ * antennas_; }
  // Writes [points of the axis x antennas] without noise, `later_s` after the previous frame.
  void frame(double later_s, Rng& rng, std::span<std::complex<float>> samples);

 private:
  class Moving;
  class Speckle;
  class Expectation;

  std::size_t points_, antennas_;
  std::vector<std::complex<float>> still_;  // samples of static scatterers
  std::unique_ptr<Moving> moving_;
};

// Samples of the room alone, coherent.
std::vector<std::complex<float>> room_echo(const AntennaRadar& radar, const Conditions& conditions);

// Antenna data of a record: radar_frames frames over window_s, with noise of this power in each
// sample.
struct AntennaRecord {
  std::vector<float> array;   // statistics of the first `kept_bins` points (ArrayStatistics)
  std::vector<double> power;  // power at each point, mean over frames and antennas
};
AntennaRecord antenna_record(const Returns& returns, const AntennaRadar& radar,
                             std::size_t kept_bins, const Conditions& conditions,
                             double noise_power, Rng& rng);

}  // namespace echofuse::sim

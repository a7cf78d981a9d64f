// SPDX-License-Identifier: MIT
// Simulates the samples of the virtual antennas of the radar. In each frame, antenna m receives
//   s_m = gain_m exp(i phase_m) sum_k a_k psf(R - R_k) exp(i pi (x_m u_k + y_m v_k)) + noise
// from echoes k with range R_k and amplitude a_k. x_m and y_m are the position of the antenna in
// half wavelengths, u_k (right) and v_k (up) the direction cosines of the echo. The mean scene as a
// single point has power 1, as in radar_power().
// If radar_sum is coherent, each cell of range, direction and height has its own complex Gaussian
// amplitude (fully developed speckle). The phase of a cell changes by 4 pi / wavelength times its
// displacement by sway, twist and breath (BodyMotion). The phases of the room and of objects are
// constant and depend only on the seed.
// If radar_sum is incoherent, the mean over any radar_frames consecutive frames has exactly the
// covariance sum_k w_k psf^2 e_k e_k^H, as for infinitely many looks. The vector e_k contains the
// factors of all antennas for the direction of echo k. Consecutive frames are uncorrelated.
// The leakage and the calibration reflector are static points. The reflector is so near that its
// wave is spherical. If the transmitter and the receiver of an antenna are at t and r, the echo
// from P has the phase
//   -2 pi (|P - t| + |P - r| - 2 |P|) / wavelength.
// The transmitters send in turn, at intervals of chirp_s, `chirps` times each. If the range
// of a target changes at v m/s, transmitter n of T (from 0) multiplies its echo by the factor
//   exp(-4 pi i v n chirp_s / wavelength) sin(pi f C) / (C sin(pi f)),
// with C = chirps and f = 2 v T chirp_s / wavelength. The quotient of sines is the fraction of the
// echo in Doppler bin 0.
// The psf of people and of the room is computed once per eighth of a resolution cell in range.
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

// Returns the positions of antennas in half wavelengths. Up to 8 antennas form a row. 12 antennas
// are the pairs of transmitters at (0,0) (2,2) (0,2) and receivers at (1,1) (1,0) (0,1) (0,0), as
// on TI's IWR6843AOP.
record::Antennas antennas_in_layout(std::size_t count);
// Returns `radar_antennas` antennas with random phase and gain errors. The errors depend only on
// the seed; their rms values are `radar_phase_error_rad` and `radar_gain_error_db`.
record::Antennas simulated_antennas(const Conditions& conditions, std::uint64_t seed);
// Returns the antennas to be stored in the run file. They include the simulated errors only if
// `radar_array_calibrated` is true.
record::Antennas stated_antennas(const record::Antennas& antennas, const Conditions& conditions);

// Motion of standing people. They sway about their ankles like an inverted pendulum (Morasso et
// al., PLoS ONE 14, e0213870, 2019), twist about a vertical axis, and breathe. The centre of
// pressure sways by some millimetres (Prieto et al., IEEE Trans. Biomed. Eng. 43, 956, 1996). At 60
// GHz, a range change of 2.5 mm changes the phase of the echo by 360 degrees.
class BodyMotion {
 public:
  // Modes of motion: sway to the right and sway away from the radar (m, at head height), twist
  // (rad), and breath (m).
  static constexpr std::size_t modes = 4;
  using Modes = std::array<float, modes>;

  // The motion of each person is random and stationary from the start. Sway and twist are
  // critically damped oscillators driven by white noise, with the covariance (1 + wt) exp(-wt) and
  // w = 2 per second. The head therefore moves at about 1 cm/s. Breathing is sinusoidal at 0.25 Hz.
  BodyMotion(const Conditions& conditions, std::size_t people, Rng& rng);
  void advance(double time_s, Rng& rng);
  // Returns the displacement of each person from the rest position, by mode of motion (m or rad,
  // see `modes`).
  const std::vector<Modes>& places() const { return places_; }
  const std::vector<Modes>& speeds() const {
    return speeds_;
  }  // time derivative of places(), per s

  // Returns the change of the range of a patch, m, per unit of each mode. x and y are the direction
  // cosines x/R and y/R of the patch, and `height_m` is its height above the floor. The vertical
  // axis of the person is at `axis_x_m`, `axis_z_m` relative to the radar.
  static Modes range_per_mode(double x, double y, double height_m, double axis_x_m, double axis_z_m,
                              double body_scale);

 private:
  struct Oscillator {
    // position, and speed divided by `sway_rate`; both have unit variance
    double place = 0, speed = 0;
  };
  void set_modes();

  static constexpr std::size_t swaying = 3;
  std::array<double, swaying> rms_;
  double breath_m_, time_s_ = 0;
  std::vector<std::array<Oscillator, swaying>> oscillators_;
  std::vector<double> breath_phase_;
  std::vector<Modes> places_, speeds_;
};

// Group of patches that the antennas cannot resolve: the sum of their weights, and the weighted
// means of the other values. Across a cell (0.03 in direction cosine), the phase difference between
// the outermost of eight antennas changes by 0.7 rad. Across the height of a cell (0.1 m), the
// phase of a body that sways by 5 mm at the head changes by 0.7 rad.
struct EchoCell {
  double weight = 0, range_m = 0, x = 0, y = 0, height_m = 0;
  std::int32_t person = Returns::still;
};
struct EchoCells {
  std::vector<EchoCell> cells;  // sorted by range slot
  // index of the first cell of each slot, followed by the total number of cells
  std::vector<std::size_t> begin;
  std::vector<double> slot_range_m;  // weighted mean range of the patches in each slot, m
  std::size_t people = 0;
};
// Combines the patches of people and, if `with_room` is true, of the room into cells. Range slots
// have the length `slot_m`.
EchoCells echo_cells(const Returns& returns, double slot_m, bool with_room);
// Combines all patches of one kind (Returns::reflector or Returns::leakage) into one cell. The
// weight of the cell is 0 if there are no such patches.
EchoCell cell_of_kind(const Returns& returns, std::int32_t kind);

// Properties of the radar that are the same for all records of a run. `still_seed` determines the
// phases of the echoes from the room and from objects.
struct AntennaRadar {
  RadarAxis axis;
  record::Antennas antennas;
  std::uint64_t still_seed = 0;
  // The antennas of one transmitter are adjacent; `receivers` is their number. The transmitters
  // send in turn, at intervals of `chirp_s`, `chirps` times per frame. If `chirp_s` is 0, all
  // transmitters send at the same time.
  std::size_t receivers = 4;
  double chirp_s = 0;
  std::int64_t chirps = 1;
  // Result of room_echo() if the room is subtracted from the returns (RoomReturns::subtracted);
  // otherwise empty.
  std::span<const std::complex<float>> room{};
  // Positions of the transmitter and the receiver of each antenna, m, relative to the mean position
  // of all transmitters and all receivers, respectively. If `pairs` is empty, the wave from the
  // reflector is treated as plane. wavelength_m is used only with `pairs`.
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
  // Writes the noise-free samples of the frame that follows the previous frame by `later_s`
  // seconds: [range point][antenna].
  void frame(double later_s, Rng& rng, std::span<std::complex<float>> samples);

 private:
  class Moving;
  class Speckle;
  class Expectation;

  std::size_t points_, antennas_;
  std::vector<std::complex<float>> still_;  // samples of static scatterers: [range point][antenna]
  std::unique_ptr<Moving> moving_;
};

// Returns the coherent samples of the empty room: [range point][antenna].
std::vector<std::complex<float>> room_echo(const AntennaRadar& radar, const Conditions& conditions);

// Antenna data of a record, which contains `radar_frames` frames in `window_s` seconds.
struct AntennaRecord {
  std::vector<float> array;   // statistics (ArrayStatistics) of the first `kept_bins` points
  std::vector<double> power;  // power at each range point, averaged over frames and antennas
};
// Simulates the antenna data of a record. `noise_power` is the noise power of each sample.
AntennaRecord antenna_record(const Returns& returns, const AntennaRadar& radar,
                             std::size_t kept_bins, const Conditions& conditions,
                             double noise_power, Rng& rng);

}  // namespace echofuse::sim

// SPDX-License-Identifier: MIT
// Virtual antennas of a simulated radar board, and their samples. An IWR6843ISK sends only the
// samples of the antennas in a row (TLV 4). A board with 12 antennas in a plane (AOP;
// radar_antennas = 12) sends the samples of all antennas (TLV 8). The phase errors and the gain
// errors depend only on the board, not on the run.
#pragma once
#include <array>
#include <complex>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sim/devices/radar_chirp.hpp"
#include "sim/devices/scene_player.hpp"
#include "sim/sensors/antennas.hpp"
#include "sim/wire/encode.hpp"

namespace echofuse::sim {

class RadarAntennas {
 public:
  RadarAntennas(const Conditions& conditions, std::uint64_t seed, const std::string& board = "isk");

  // Starts sampling with this chirp. `mean_peak` is the result of mean_peak_power(), and determines
  // the noise power as in range_profile_codes().
  void start(const Chirp& chirp, double mean_peak);
  // Samples one frame at all antennas. `gain` multiplies the signal power. The phases are those of
  // the first subframe, even if another subframe has a different start frequency.
  void sample_frame(const RenderedScene& rendered, double time_s, double gain, Rng& rng);
  // Returns the range profile codes of the last frame, computed from its samples. Valid only for
  // coherent echoes.
  std::vector<std::uint16_t> profile_codes() const;
  RadarTlv tlv() const;
  // Returns the antenna factors printed by measureRangeBiasAndRxChanPhase: a real and an imaginary
  // part for each antenna.
  std::string coefficients() const;

 private:
  static constexpr std::size_t receivers = 4, transmitters = 3;

  const Conditions& conditions_;
  std::uint64_t seed_;
  bool planar_;
  record::Antennas channels_;  // all antennas: one per pair of transmitter and receiver
  // positions of the transmitter and receiver of each antenna
  std::vector<AntennaRadar::TxRxPair> pairs_;
  std::vector<AntennaRadar::TxRxPair> used_pairs_;
  double wavelength_m_ = 0;
  record::Antennas used_;  // antennas used by the chirp, in the order of the transmitters
  // number of leading antennas in used_ for which samples are sent
  std::size_t sent_ = 0;
  RadarAxis axis_;
  double chirp_s_ = 0;
  std::int64_t chirps_ = 1;
  std::size_t receivers_used_ = receivers;
  std::vector<std::size_t> numbers_;  // index in channels_ of each antenna in used_
  double noise_power_ = 0, sampled_s_ = 0;
  std::int64_t scene_ = -1;
  std::optional<AntennaEcho> echo_;
  // Amplitudes of the last frame, [range bin][antenna], relative to the amplitude of the mean
  // scene.
  std::vector<std::complex<float>> samples_;
};

}  // namespace echofuse::sim

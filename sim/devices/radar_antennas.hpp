// SPDX-License-Identifier: MIT
// Virtual antennas of a simulated board, and their samples. An IWR6843ISK sends the samples of a
// row (TLV 4), a board with 12 antennas in a plane (radar_antennas = 12: the AOP) all of them (TLV
// 8). Errors of phase and gain are fixed per board, not per run.
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

  // Sets the chirp. The noise equals that of range_profile_codes.
  void start(const Chirp& chirp, double mean_peak);
  // Samples one frame at all antennas; `gain` scales the signal. The phases do not depend on a
  // subframe's start frequency.
  void sample_frame(const RenderedScene& rendered, double time_s, double gain, Rng& rng);
  // Returns the range profile of this frame, from the same samples; coherent echoes only.
  std::vector<std::uint16_t> profile_codes() const;
  RadarTlv tlv() const;
  // Returns the result of measureRangeBiasAndRxChanPhase: one factor per antenna.
  std::string coefficients() const;

 private:
  static constexpr std::size_t receivers = 4, transmitters = 3;

  const Conditions& conditions_;
  std::uint64_t seed_;
  bool planar_;
  record::Antennas channels_;                  // one per pair of transmitter and receiver
  std::vector<AntennaRadar::TxRxPair> pairs_;  // transmitters and receivers of channels_
  std::vector<AntennaRadar::TxRxPair> used_pairs_;
  double wavelength_m_ = 0;
  record::Antennas used_;  // antennas of the chirp, in transmitter order
  std::size_t sent_ = 0;   // number of sent antennas, from the first
  RadarAxis axis_;
  double chirp_s_ = 0;
  std::int64_t chirps_ = 1;
  std::size_t receivers_used_ = receivers;
  std::vector<std::size_t> numbers_;  // indices of used_ in channels_
  double noise_power_ = 0, sampled_s_ = 0;
  std::int64_t scene_ = -1;
  std::optional<AntennaEcho> echo_;
  std::vector<std::complex<float>> samples_;  // in the firmware's integers
};

}  // namespace echofuse::sim

// SPDX-License-Identifier: MIT
// Virtual antennas of a simulated board, and their samples while it runs. An IWR6843ISK sends a
// row's samples (TLV 4), a board with 12 antennas in a plane (radar_antennas = 12: the AOP) all of
// them (TLV 8). Both have errors of phase and gain: they are the board's, not the run's.
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

  // The board starts with this chirp. The noise is that of range_profile_codes.
  void start(const Chirp& chirp, double mean_peak);
  // Samples a frame at this time at all antennas, with `gain` times the true strength. The start
  // frequency of a subframe does not change its phases.
  void look(const RenderedScene& rendered, double time_s, double gain, Rng& rng);
  // Range profile of this frame: coherent echoes only, from the same samples.
  std::vector<std::uint16_t> profile_codes() const;
  RadarTlv tlv() const;
  // Returns what measureRangeBiasAndRxChanPhase finds: the factors for each antenna's samples.
  std::string coefficients() const;

 private:
  static constexpr std::size_t receivers = 4, transmitters = 3;

  const Conditions& conditions_;
  std::uint64_t seed_;
  bool planar_;
  record::Antennas channels_;              // one for each transmitter with each receiver
  std::vector<AntennaRadar::Pair> pairs_;  // transmitters and receivers of channels_
  std::vector<AntennaRadar::Pair> used_pairs_;
  double wavelength_m_ = 0;
  record::Antennas used_;  // those of the chirp, in the order of its transmitters
  std::size_t sent_ = 0;   // number of them that are sent, from the first
  RadarAxis axis_;
  double chirp_s_ = 0;
  std::int64_t chirps_ = 1;
  std::size_t receivers_used_ = receivers;
  std::vector<std::size_t> numbers_;  // numbers of used_ among channels_
  double noise_power_ = 0, seen_s_ = 0;
  std::int64_t scene_ = -1;
  std::optional<AntennaEcho> echo_;
  std::vector<std::complex<float>> samples_;  // in the firmware's integers
};

}  // namespace echofuse::sim

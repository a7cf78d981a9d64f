// SPDX-License-Identifier: MIT
// Places of the virtual antennas of TI's IWR6843 boards. A virtual antenna is a pair of a
// transmitter and a receiver; it stands where the sum of their places is.
//
// Sources: antenna figures and geometry lines {azimuth, elevation} of the mmWave Industrial Toolbox
// 4.7 and 4.10 for the boards, in half wavelengths at 62 GHz:
//   isk  tx (0,1) (2,0) (4,1)  rx (0,0) (1,0) (2,0) (3,0)
//   aop  tx (0,0) (2,2) (0,2)  rx (1,1) (1,0) (0,1) (0,0)
//   ods  tx (0,0) (2,0) (2,2)  rx (0,0) (0,1) (1,1) (1,0)
// Here the row of transmitters 1 and 3 of the ISK has y = 0. x is to the right as seen from behind
// the radar, as the demo's own points have it (a phase that grows with x is a wave from the right).
// Several antennas of the AOP and of the ODS are fed with half a wave more (TI's own neutral line
// of the AOP is 1 0 -1 0 ...; antPhaseRot of TI's cfgs for the ODS turns the virtual antennas 2, 3,
// 6, 7, 10 and 11).
// That is no place but a phase: `echofuse-acquire calibrate` measures it with all others.
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/core/axis.hpp"

namespace echofuse::radar {

enum class Board { isk, aop, ods };
// As radar.board of the configuration spells them.
std::vector<std::string> board_names();
std::optional<Board> board_named(std::string_view name);

// A planar array is sent as TLV 8 with all antennas, a linear one as TLV 4 with those of a row.
constexpr bool is_planar(Board board) { return board != Board::isk; }

constexpr double half_wavelength_m = speed_of_light_m_s / (2 * 62e9);

struct AntennaPlace {
  int x = 0, y = 0;  // half wavelengths
  bool operator==(const AntennaPlace&) const = default;
};

struct AntennaPair {
  AntennaPlace tx, rx;
};

// Pairs of the antennas of the heat map that guiMonitor asks for, in the order of its TLV: the
// receivers of the frame's first transmitter, then those of the next. `tx`: the transmitters from
// 0, in the order of the frame's chirps; of a linear array the firmware takes as many of the first
// ones as stand in the row (SDK 3.4, AoAProcDSP_RangeAzimuthHeatmap). `rx`: mask of the receivers
// that are on.
std::vector<AntennaPair> heat_map_pairs(Board board, std::span<const std::uint32_t> tx,
                                        std::uint32_t rx);
// Their places.
std::vector<AntennaPlace> heat_map_antennas(Board board, std::span<const std::uint32_t> tx,
                                            std::uint32_t rx);

}  // namespace echofuse::radar

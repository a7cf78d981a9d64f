// SPDX-License-Identifier: MIT
// Positions of the virtual antennas of TI's IWR6843 boards. A virtual antenna is a pair of a
// transmitter and a receiver; its position is the sum of the positions of both.
//
// Sources: antenna figures and geometry lines {azimuth, elevation} of the mmWave Industrial Toolbox
// 4.7 and 4.10 for the boards, in half wavelengths at 62 GHz:
//   isk  tx (0,1) (2,0) (4,1)  rx (0,0) (1,0) (2,0) (3,0)
//   aop  tx (0,0) (2,2) (0,2)  rx (1,1) (1,0) (0,1) (0,0)
//   ods  tx (0,0) (2,0) (2,2)  rx (0,0) (0,1) (1,1) (1,0)
// Here the row of transmitters 1 and 3 of the ISK has y = 0. x points right as seen from behind the
// radar, as in the demo's point cloud: if the phase increases with x, the wave comes from the
// right. Several antennas of the AOP and the ODS have a feed delay of half a wavelength (TI's
// neutral line for the AOP is 1 0 -1 0 ...; antPhaseRot in TI's ODS cfgs inverts virtual antennas
// 2, 3, 6, 7, 10 and 11). This is a phase, not a position: `echofuse-acquire calibrate` measures it
// for all antennas.
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
// Returns the names that radar.board accepts in the configuration.
std::vector<std::string> board_names();
std::optional<Board> board_named(std::string_view name);

// The firmware sends the heat map of a planar array as TLV 8 with all antennas, and that of a
// linear array as TLV 4 with the antennas of one row.
constexpr bool is_planar(Board board) { return board != Board::isk; }

constexpr double half_wavelength_m = speed_of_light_m_s / (2 * 62e9);

struct AntennaPlace {
  int x = 0, y = 0;  // position in units of half a wavelength
  bool operator==(const AntennaPlace&) const = default;
};

struct AntennaPair {
  AntennaPlace tx, rx;
};

// Returns the antenna pairs of the heat map that guiMonitor requests, in the order of the TLV: all
// receivers of the first transmitter, then all receivers of the next. For a linear array, the
// firmware uses the first N transmitters, where N is the number of transmitters in the row (SDK
// 3.4, AoAProcDSP_RangeAzimuthHeatmap). `tx`: indices of the transmitters from 0, in chirp order.
// `rx`: mask of enabled receivers.
std::vector<AntennaPair> heat_map_pairs(Board board, std::span<const std::uint32_t> tx,
                                        std::uint32_t rx);
// Returns the positions of the virtual antennas formed by heat_map_pairs().
std::vector<AntennaPlace> heat_map_antennas(Board board, std::span<const std::uint32_t> tx,
                                            std::uint32_t rx);

}  // namespace echofuse::radar

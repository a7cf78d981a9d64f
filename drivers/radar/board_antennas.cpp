// SPDX-License-Identifier: MIT
#include "drivers/radar/board_antennas.hpp"

#include <algorithm>
#include <array>

namespace echofuse::radar {
namespace {

struct BoardLayout {
  Board board;
  const char* name;
  std::array<AntennaPlace, 3> tx;
  std::array<AntennaPlace, 4> rx;
};

constexpr BoardLayout layouts[] = {
    {Board::isk, "isk", {{{0, 0}, {2, -1}, {4, 0}}}, {{{0, 0}, {1, 0}, {2, 0}, {3, 0}}}},
    {Board::aop, "aop", {{{0, 0}, {2, 2}, {0, 2}}}, {{{1, 1}, {1, 0}, {0, 1}, {0, 0}}}},
    {Board::ods, "ods", {{{0, 0}, {2, 0}, {2, 2}}}, {{{0, 0}, {0, 1}, {1, 1}, {1, 0}}}},
};

}  // namespace

std::vector<std::string> board_names() {
  std::vector<std::string> names;
  for (const BoardLayout& l : layouts) names.emplace_back(l.name);
  return names;
}

std::optional<Board> board_named(std::string_view name) {
  for (const BoardLayout& l : layouts)
    if (name == l.name) return l.board;
  return std::nullopt;
}

std::vector<AntennaPair> heat_map_pairs(Board board, std::span<const std::uint32_t> tx,
                                        std::uint32_t rx) {
  const BoardLayout& layout = layouts[static_cast<std::size_t>(board)];
  if (!is_planar(board)) {
    // index of the transmitter that is not in the same row as the other two
    constexpr std::uint32_t above = 1;
    const auto elevated = static_cast<std::size_t>(std::count(tx.begin(), tx.end(), above));
    if (tx.size() > elevated) tx = tx.first(tx.size() - elevated);
  }
  std::vector<AntennaPair> pairs;
  for (const std::uint32_t t : tx)
    for (std::uint32_t r = 0; r < layout.rx.size(); ++r)
      if (rx >> r & 1) pairs.push_back({layout.tx[t], layout.rx[r]});
  return pairs;
}

std::vector<AntennaPlace> heat_map_antennas(Board board, std::span<const std::uint32_t> tx,
                                            std::uint32_t rx) {
  std::vector<AntennaPlace> places;
  for (const auto& [from, to] : heat_map_pairs(board, tx, rx))
    places.push_back({from.x + to.x, from.y + to.y});
  return places;
}

}  // namespace echofuse::radar

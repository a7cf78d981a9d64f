// SPDX-License-Identifier: MIT
#include "sim/sensors/array_cells.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace echofuse::sim {
namespace {

using Key = std::array<std::int64_t, 4>;  // range, person, height, direction

Key key_of(const Returns& returns, std::size_t k, const CellSize& size) {
  const Returns::Place& p = returns.place[k];
  const auto step = [](double value, double width) {
    return static_cast<std::int64_t>(std::floor(value / width));
  };
  return {step(returns.range_m[k], size.range_m), p.person, step(p.height_m, size.height_m),
          step(p.x, size.cosine)};
}

void add(ArrayCell& cell, const Returns& returns, std::size_t k) {
  const Returns::Place& p = returns.place[k];
  const double w = returns.weight[k];
  cell.weight += w;
  cell.range_m += w * returns.range_m[k];
  cell.x += w * p.x;
  cell.y += w * p.y;
  cell.height_m += w * p.height_m;
  cell.person = p.person;
}

void divide(ArrayCell& cell) {
  for (double* sum : {&cell.range_m, &cell.x, &cell.y, &cell.height_m}) *sum /= cell.weight;
}

// The corners of all keys, and a number for each key between them.
struct Box {
  Key low, high;

  explicit Box(const Key& first) : low(first), high(first) {}
  void extend(const Key& key) {
    for (std::size_t i = 0; i < key.size(); ++i) {
      low[i] = std::min(low[i], key[i]);
      high[i] = std::max(high[i], key[i]);
    }
  }
  std::int64_t span(std::size_t i) const { return high[i] - low[i] + 1; }
  std::size_t size() const {
    return static_cast<std::size_t>(span(0) * span(1) * span(2) * span(3));
  }
  std::size_t number(const Key& key) const {
    std::int64_t n = 0;
    for (std::size_t i = 0; i < key.size(); ++i) n = n * span(i) + key[i] - low[i];
    return static_cast<std::size_t>(n);
  }
};

void number_slots(ArrayCells& out, const CellSize& size) {
  double weight = 0;
  std::int64_t before = -1;
  for (ArrayCell& cell : out.cells) {
    const auto slot = static_cast<std::int64_t>(std::floor(cell.range_m / size.range_m));
    if (slot != before) {
      if (!out.slot_range_m.empty()) out.slot_range_m.back() /= weight;
      out.slot_range_m.push_back(0);
      weight = 0;
    }
    before = slot;
    cell.slot = out.slot_range_m.size() - 1;
    out.slot_range_m.back() += cell.weight * cell.range_m;
    weight += cell.weight;
  }
  if (!out.slot_range_m.empty()) out.slot_range_m.back() /= weight;
}

}  // namespace

ArrayCells cells_of(const Returns& returns, const CellSize& size, Echoes which) {
  std::vector<std::size_t> patches;
  for (std::size_t k = 0; k < returns.place.size(); ++k) {
    const std::int32_t person = returns.place[k].person;
    const bool wanted =
        person >= 0 || (person == Returns::still && which == Echoes::of_people_and_room);
    if (wanted && returns.weight[k] > 0 && returns.range_m[k] > 0) patches.push_back(k);
  }
  ArrayCells out;
  if (patches.empty()) return out;
  std::vector<Key> keys;
  keys.reserve(patches.size());
  for (const std::size_t k : patches) keys.push_back(key_of(returns, k, size));
  Box box(keys.front());
  for (const Key& key : keys) box.extend(key);
  // In the box's order, so that the cells of a slot stand together.
  constexpr std::uint32_t none = UINT32_MAX;
  std::vector<std::uint32_t> cell_at(box.size(), none);
  for (const Key& key : keys) cell_at[box.number(key)] = 0;
  std::uint32_t cells = 0;
  for (std::uint32_t& cell : cell_at)
    if (cell != none) cell = cells++;
  out.cells.resize(cells);
  for (std::size_t i = 0; i < patches.size(); ++i)
    add(out.cells[cell_at[box.number(keys[i])]], returns, patches[i]);
  for (ArrayCell& cell : out.cells) {
    divide(cell);
    out.people = std::max(out.people, static_cast<std::size_t>(cell.person + 1));
  }
  number_slots(out, size);
  return out;
}

ArrayCell one_cell_of(const Returns& returns, std::int32_t kind) {
  ArrayCell cell;
  for (std::size_t k = 0; k < returns.place.size(); ++k)
    if (returns.place[k].person == kind) add(cell, returns, k);
  if (cell.weight > 0) divide(cell);
  return cell;
}

}  // namespace echofuse::sim

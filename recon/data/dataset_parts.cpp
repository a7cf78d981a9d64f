// SPDX-License-Identifier: MIT
#include "recon/data/dataset.hpp"

namespace echofuse::recon {

Dataset part_of(const Dataset& data, const Rows& rows) {
  Dataset out;
  out.spd_axis = data.spd_axis, out.radar_axis = data.radar_axis, out.map = data.map;
  out.array_axis = data.array_axis;
  out.spd = take_rows(data.spd, rows), out.radar = take_rows(data.radar, rows);
  out.array = take_rows(data.array, rows);
  out.empty_room = data.empty_room;
  out.depth = take_rows(data.depth, rows);
  for (const std::size_t row : rows) {
    out.valid.push_back(data.valid[row]);
    out.index.push_back(data.index[row]);
    out.slot_end.push_back(data.slot_end[row]);
    out.speckle.push_back(data.speckle[row]);
    out.clicks_a_pulse.push_back(data.clicks_a_pulse[row]);
    out.label.push_back(data.label[row]);
  }
  return out;
}

Dataset part_of_run(const Dataset& data, const Rows& rows) {
  Dataset out = part_of(data, rows);
  out.sources = {data.sources.front()};
  out.sources.front().first = 0, out.sources.front().count = rows.size();
  out.hash = data.hash;
  return out;
}

}  // namespace echofuse::recon

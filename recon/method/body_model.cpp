// SPDX-License-Identifier: MIT
#include <algorithm>

#include "recon/method/method.hpp"

namespace echofuse::recon {

Cost cost(const BodyModel& model) {
  const std::size_t basis = model.masks.basis.values.size() + model.depths.basis.values.size();
  Cost out{basis + model.frame.draw_cost(), basis + model.masks.mean.size() +
                                                model.depths.mean.size() + 2 * model.centre.size() +
                                                model.background.size()};
  out += model.place.cost();
  out += model.shape.cost();
  return out;
}

void BodyModel::archive(Archive archive, std::size_t inputs, const record::MapGrid& grid) {
  frame.archive(archive.in("frame"), grid);
  archive.values("background_m", background, grid.pixels());
  archive.number("threshold", threshold, 0, 1);
  archive.number("nearest_m", nearest_m, 0, 10);
  archive.values("centre", centre, inputs);
  archive.values("deviation", deviation, inputs);
  archive.require(std::all_of(deviation.begin(), deviation.end(), [](float d) { return d > 0; }),
                  "deviation", "expected positive values only");
  place.archive(archive.in("place"), inputs, 2);
  recon::archive(archive.in("masks"), masks, frame.size());
  recon::archive(archive.in("depths"), depths, frame.size());
  const std::size_t amounts = masks.basis.rows + depths.basis.rows;
  archive.require(has_shapes == (amounts > 0), "masks",
                  "expected shape components if, and only if, the model has shapes");
  if (has_shapes) shape.archive(archive.in("shape"), inputs, amounts);
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include <unistd.h>

#include <cmath>

#include "drivers/program/printable.hpp"
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

void require_memory(const std::vector<std::string>& paths) {
  constexpr double bytes_a_record = 25e3;
  double records = 0;
  for (const auto& path : paths) records += static_cast<double>(record::RunReader(path).count());
  const double memory =
      static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE));
  if (records * bytes_a_record <= memory) return;
  const auto gigabytes = [](double bytes) { return std::to_string(std::lround(bytes / 1e9)); };
  throw Error(ExitCode::failed, printable(paths.front()) + ": " +
                                    std::to_string(std::lround(records)) + " records take about " +
                                    gigabytes(records * bytes_a_record) +
                                    " GB, and this machine's memory is " + gigabytes(memory) +
                                    " GB; give fewer records");
}

}  // namespace echofuse::recon

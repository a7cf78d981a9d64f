// SPDX-License-Identifier: MIT
// A run for other people's tools.
//
// HDF5, NeXus-like (NXentry / NXdata), units on every array; n records in the order of the run:
//   /entry               title, entry_identifier, start_time, end_time, configuration, radar_cfg
//   /entry/data          spd u32 [n, bins]  radar f32 [n, bins]  depth u16 [n, rows, columns] mm
//                        array f32 [n, bins, values] of a radar that sends its antennas' samples,
//                        the values of each bin as measurement/radar_array.hpp has them,
//                        array_frames u64 [n]; and their axes spd_time (ps, start of each bin),
//                        radar_range (m), array_range (m), depth_x, depth_y (tangents); valid u8
//                        [n] (bit 0 SPD, 1 radar, 2 depth) index, slot_start, slot_end, slot_utc
//                        i64 [n] (ns), label text [n]
//   /entry/sync/SENSOR   offset, span (s), used, lost, verdict, each [n]
//   /entry/instrument/SENSOR   address, model, serial, firmware
//   /entry/tables/TABLE/COLUMN   all else that the run file holds (acquire/record/schema.hpp):
//   marks
//                        and labels (event), --meta (meta), counters, clock fits, ...; i64 with
//                        `missing_value`, f64 with NaN, or text
// Where a sensor is not valid, spd and depth hold zeros and radar and array hold NaN.
#pragma once
#include <cstdint>
#include <functional>
#include <string>

#include "acquire/record/run_file.hpp"

namespace echofuse::record {

// Both refuse a path that exists; the file is there when it is whole, and not if they fail. Of a
// run in parts, `files` are all of them, and n counts the records of all. A record that cannot be
// read is exported without valid sensors, with the reason as its verdicts; returns how many there
// were.
std::int64_t export_h5(
    const std::vector<std::string>& files, const std::string& path,
    const std::function<void(std::int64_t done, std::int64_t total)>& progress = {});

// One record, without the array, as lines "sensor,x,y,value" under a "#" header that names the
// units.
void export_csv(const RunReader& run, std::int64_t index, const std::string& path);

}  // namespace echofuse::record

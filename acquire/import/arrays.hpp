// SPDX-License-Identifier: MIT
// A folder of NumPy arrays as a run: the way in for histograms and maps of other programs.
//   spd.npy     [n, bins] counts; a row of NaN: no SPD in that record
//   radar.npy   [n, points] linear power; a row of NaN: no radar
//   depth.npy   [n, rows, columns] z, whole numbers of millimetres or float metres; 0, NaN: no
//   return run.toml    axes with units, slot length, labels; `run.toml` keys: bind() in arrays.cpp
// One of the first two is enough. Slot i begins i slot lengths after `began`.
#pragma once
#include <string>

#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

// Makes the run file `out` and returns one line that says what is in it. Throws Error: run.toml
// does not fit (config), arrays cannot be read or do not fit each other (failed), disk.
std::string import_arrays(const std::string& folder, const std::string& out, UtcTime began);

}  // namespace echofuse::acquire

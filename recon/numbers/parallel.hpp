// SPDX-License-Identifier: MIT
// Parts of a calculation on several threads. The result is the same bit by bit with any number of
// threads if the parts depend on the shape of the calculation alone.
//
// Threading: for_each_part() from any threads, but not from within a part; set_threads() while none
// calculates.
#pragma once
#include <cstddef>
#include <functional>

namespace echofuse::recon {

void set_threads(int count);  // this one included; 0: one per core, which is the default

// Calls work(0) ... work(parts - 1), in any order, and returns when all are done. `work` must not
// throw.
void for_each_part(std::size_t parts, const std::function<void(std::size_t)>& work);

}  // namespace echofuse::recon

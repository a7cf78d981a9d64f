// SPDX-License-Identifier: MIT
// Runs the parts of a calculation on several threads. The result is identical bit for bit for any
// number of threads if the parts depend only on the shape of the calculation.
//
// Threading: any thread may call for_each_part(), but not from within a part; set_threads() may be
// called while no calculation runs.
#pragma once
#include <cstddef>
#include <functional>

namespace echofuse::recon {

// Sets the number of threads, including the calling thread; 0 (the default) means one per core.
void set_threads(int count);

// Calls work(0) ... work(parts - 1) in any order, and returns when all are done. `work` must not
// throw.
void for_each_part(std::size_t parts, const std::function<void(std::size_t)>& work);

}  // namespace echofuse::recon

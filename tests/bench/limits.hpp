// SPDX-License-Identifier: MIT
// Measures the limits of this machine on one thread, and prints rows for the table of scripts/bench
// (table.py). Times are processor times, each the best of several rounds, because other processes
// may be running.
#pragma once
#include <algorithm>
#include <cstddef>
#include <ctime>
#include <limits>

namespace echofuse::bench {

inline double processor_s() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

template <class Work>
double best_s(int rounds, const Work& work) {
  double best = std::numeric_limits<double>::max();
  for (int i = 0; i < rounds; ++i) {
    const double begin = processor_s();
    work();
    best = std::min(best, processor_s() - begin);
  }
  return best;
}

const char* instructions();    // name of the vector instruction set
double multiply_adds_per_s();  // rate in single precision, with all operands in registers
// Returns the rate of repeated reads from the same memory block. `of` is its size in bytes.
double bytes_read_per_s(std::size_t of);

// Prints the value measured for echofuse by one benchmark, and the limit of the machine. If the
// unit contains "/s", both values are rates; otherwise, they are times. The limit 0 means "no
// limit".
void print_row(const char* path, const char* unit, double ours, double limit, const char* of_what);
// Prints the value of a peer program in the unit of the benchmark.
void print_peer(const char* path, const char* peer, double value);

}  // namespace echofuse::bench

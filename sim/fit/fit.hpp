// SPDX-License-Identifier: MIT
// What a run tells of its laboratory, as estimates with errors and as a twin's ranges.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "acquire/record/record.hpp"
#include "sim/fit/statistics.hpp"
#include "sim/twin/twin.hpp"

namespace echofuse::sim {

struct FitOptions {
  Conditions nominal;               // axes as the run's, and what the laboratory states
  std::int64_t laboratories = 200;  // to simulate, in each of two rounds
  std::int64_t records = 50;        // in each, at most as many as the run has
  std::uint64_t seed = 1;
  bool quiet = false;
};

// A key of the default twin, or a ratio of them. Reflectivities of the radar, its leakage and its
// noise are in units of radar_cloth: the unit of its power is not known.
struct Estimate {
  std::string name;
  bool is_key = true, logarithmic = false;
  bool told = false;  // the error is less than half the default range's
  double value = 0;
  double standard_error = 0;  // of the logarithm, if logarithmic
  double before = 0;          // standard deviation over the default twin's laboratories
  std::string reason;         // why it cannot be told
};

struct Fit {
  std::vector<Estimate> estimates;
  EmptyRoom empty;
  std::int64_t used = 0;            // records with one person
  double signal_counts = 0;         // median of these records, without background
  std::vector<std::string> unlike;  // statistics beyond 5 spreads of all simulated laboratories
};

// Regression of each quantity on a run's statistics (statistics.hpp), learned on laboratories of
// the default twin, then again on laboratories within 3 standard errors of what was found
// (regression with sequential narrowing, after Beaumont, Zhang and Balding, Genetics 162, 2025,
// 2002). Throws Error(failed) with fewer than ten records of one person.
Fit fit_twin(const std::vector<record::FusedRecord>& records, const FitOptions& options);

// The value that a fit estimates, of a laboratory whose truth is known.
double truth_of(const Estimate& estimate, const Conditions& laboratory);

std::string report_of(const Fit& fit);
// Estimate +- 2 standard errors of what is told; the default range of everything else.
std::string twin_of(const Fit& fit, const std::string& run);

}  // namespace echofuse::sim

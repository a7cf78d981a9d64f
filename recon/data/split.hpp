// SPDX-License-Identifier: MIT
// Split of the records into training, validation (early stopping) and test.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

struct SplitOptions {
  // random: for independent scenes (the paper's 9:1). blocked: for sequences, where neighbours in
  // time are alike: training records, a gap, validation, a gap, test, in the order of the records.
  std::string kind = "random";
  double test_share = 0.1;
  double validation_share = 0.05;  // share of the records that are not in the test
  std::size_t gap = 10;            // records dropped between blocks
  std::uint64_t seed = 1;
};

struct Split {
  Rows train, validation, test;
};

// Returns the rows in a reproducible random order. The sort key is
// mix(mix(seed ^ mix(stream)) ^ row); mix() is one step of SplitMix64 (drivers/core/random.hpp).
Rows drawn(Rows rows, std::uint64_t seed, std::uint64_t stream);

// Splits `rows`; a random split takes the end of drawn() for validation and test. Throws
// Error(failed) if too few are left for training.
Split make_split(const Rows& rows, const SplitOptions& options);

// Fold: block `fold` of `folds` is the test; training rows within `gap` records of it are dropped.
Split make_fold(const Rows& rows, std::size_t fold, std::size_t folds, std::size_t gap);
// Returns all folds: blocked, with as much of the gap as the number of records allows, or random.
std::vector<Split> make_folds(Rows rows, std::size_t folds, const SplitOptions& options,
                              std::uint64_t stream);

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
// Splits records into training, validation (for early stopping) and test records.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

struct SplitOptions {
  // random: for independent scenes (90 % training and 10 % test, as in Lai et al., 2024). blocked:
  // for sequences in which successive records are similar. In record order, the blocks are
  // training, gap, validation, gap and test.
  std::string kind = "random";
  double test_share = 0.1;
  double validation_share = 0.05;  // validation records as a fraction of all non-test records
  std::size_t gap = 10;            // number of records dropped between two blocks
  std::uint64_t seed = 1;
};

struct Split {
  Rows train, validation, test;
};

// Returns the rows in a reproducible random order. The sort key is
// mix(mix(seed ^ mix(stream)) ^ row); mix() is one step of SplitMix64 (drivers/core/random.hpp).
Rows drawn(Rows rows, std::uint64_t seed, std::uint64_t stream);

// Splits `rows` into training, validation and test rows. A random split uses the last rows of
// drawn() for test and validation. Throws Error(failed) if fewer than two rows remain for training.
Split make_split(const Rows& rows, const SplitOptions& options);

// Returns one fold of the cross-validation. Block `fold` of `folds` is the test set, and rows
// within `gap` records of it are excluded from training.
Split make_fold(const Rows& rows, std::size_t fold, std::size_t folds, std::size_t gap);
// Returns all folds. Blocked folds keep options.gap, or a smaller gap if there are few records;
// random folds have no gap.
std::vector<Split> make_folds(Rows rows, std::size_t folds, const SplitOptions& options,
                              std::uint64_t stream);

}  // namespace echofuse::recon

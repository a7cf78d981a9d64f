// SPDX-License-Identifier: MIT
// A split says which records train, which stop the training early, and which are used by neither.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

struct SplitOptions {
  // random is for independent scenes (the paper's 9:1). blocked is for sequences, where neighbours
  // in time leak: training records, a gap, validation, a gap, test, in the order of the records.
  std::string kind = "random";
  double test_share = 0.1;
  double validation_share = 0.05;  // share of the rest, which is for training
  std::size_t gap = 10;            // records dropped between two blocks
  std::uint64_t seed = 1;
};

struct Split {
  Rows train, validation, test;
};

// Returns the rows in a random order that any program can repeat. The sort key is
// mix(mix(seed ^ mix(stream)) ^ row); mix() is one step of SplitMix64 (drivers/core/random.hpp).
Rows drawn(Rows rows, std::uint64_t seed, std::uint64_t stream);

// Splits `rows`; a random split draws the last ones of drawn(). Throws Error(failed) if nothing is
// left to train on.
Split make_split(const Rows& rows, const SplitOptions& options);

// Block `fold` of `folds` is the test rows; the training rows stay `gap` records away from it.
Split make_fold(const Rows& rows, std::size_t fold, std::size_t folds, std::size_t gap);
// Returns all folds. They are blocked with their gap, as far as so few records allow one, or else
// made of drawn rows.
std::vector<Split> make_folds(Rows rows, std::size_t folds, const SplitOptions& options,
                              std::uint64_t stream);

}  // namespace echofuse::recon

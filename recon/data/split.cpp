// SPDX-License-Identifier: MIT
#include "recon/data/split.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "drivers/core/random.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t split_stream = 0x73706c6974;  // "split" in ASCII

std::size_t share_of(double share, std::size_t n) {
  return static_cast<std::size_t>(std::llround(share * static_cast<double>(n)));
}

Rows take_last(Rows& rows, std::size_t n) {
  n = std::min(n, rows.size());
  Rows taken(rows.end() - static_cast<std::ptrdiff_t>(n), rows.end());
  rows.resize(rows.size() - n);
  return taken;
}

}  // namespace

Rows drawn(Rows rows, std::uint64_t seed, std::uint64_t stream) {
  const std::uint64_t key = mix(seed ^ mix(stream));
  std::ranges::sort(rows, {}, [&](std::size_t row) { return std::pair(mix(key ^ row), row); });
  return rows;
}

Split make_split(const Rows& rows, const SplitOptions& options) {
  const bool blocked = options.kind == "blocked";
  Split split;
  split.train = rows;
  if (!blocked) split.train = drawn(std::move(split.train), options.seed, split_stream);
  const auto cut = [&](double share) {
    Rows part = take_last(split.train, share_of(share, split.train.size()));
    if (blocked && !part.empty()) take_last(split.train, options.gap);
    std::sort(part.begin(), part.end());
    return part;
  };
  split.test = cut(options.test_share);
  split.validation = cut(options.validation_share);
  std::sort(split.train.begin(), split.train.end());
  if (split.train.size() < 2)
    throw Error(ExitCode::failed, std::to_string(rows.size()) + " usable records leave " +
                                      std::to_string(split.train.size()) +
                                      " for training after the split; expected at least 2");
  return split;
}

Split make_fold(const Rows& rows, std::size_t fold, std::size_t folds, std::size_t gap) {
  const std::size_t first = rows.size() * fold / folds, last = rows.size() * (fold + 1) / folds;
  Split split;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (i >= first && i < last) split.test.push_back(rows[i]);
    if (i + gap < first || i >= last + gap) split.train.push_back(rows[i]);
  }
  if (split.train.size() < 2 || split.test.empty())
    throw Error(ExitCode::failed, std::to_string(rows.size()) + " usable records are too few for " +
                                      std::to_string(folds) + " folds with a gap of " +
                                      std::to_string(gap) +
                                      "; use more records, fewer folds or a smaller gap");
  return split;
}

std::vector<Split> make_folds(Rows rows, std::size_t folds, const SplitOptions& options,
                              std::uint64_t stream) {
  const bool blocked = options.kind == "blocked";
  if (!blocked) rows = drawn(std::move(rows), options.seed, stream);
  const std::size_t gap = blocked ? std::min(options.gap, rows.size() / (4 * folds)) : 0;
  std::vector<Split> out;
  for (std::size_t k = 0; k < folds; ++k) out.push_back(make_fold(rows, k, folds, gap));
  return out;
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include "recon/method/bin_sums.hpp"

#include <algorithm>
#include <cstring>
#include <limits>

#include "drivers/core/clones.hpp"

namespace echofuse::recon {
namespace {

float minimum_of(Negative negative) {
  return negative == Negative::left_out ? 0.f : std::numeric_limits<float>::lowest();
}

ECHOFUSE_CLONES BinSums sum(const float* counts, const float* all, std::size_t from, std::size_t to,
                            float minimum) {
  constexpr std::size_t four = 4;
  using Floats [[gnu::vector_size(4 * four)]] = float;
  using Doubles [[gnu::vector_size(8 * four)]] = double;
  Doubles counts_in{}, all_in{}, moment{}, bin{0, 1, 2, 3};
  bin += static_cast<double>(from);
  std::size_t i = from;
  for (; i + four <= to; i += four, bin += double{four}) {
    Floats here, with_background;
    std::memcpy(&here, counts + i, sizeof here);
    std::memcpy(&with_background, all + i, sizeof with_background);
    const Doubles weight =
        __builtin_convertvector(here > minimum ? here : Floats{} + minimum, Doubles);
    counts_in += weight, moment += weight * bin;
    all_in += __builtin_convertvector(with_background, Doubles);
  }
  BinSums out;
  for (; i < to; ++i) {
    const double weight = double{std::max(counts[i], minimum)};
    out.counts += weight, out.moment += weight * static_cast<double>(i);
    out.all += double{all[i]};
  }
  for (std::size_t k = 0; k < four; ++k)
    out.counts += counts_in[k], out.all += all_in[k], out.moment += moment[k];
  return out;
}

}  // namespace

BinSums bin_sums(std::span<const float> counts, std::span<const float> all, std::size_t from,
                 std::size_t to, Negative negative) {
  return sum(counts.data(), all.data(), from, to, minimum_of(negative));
}

}  // namespace echofuse::recon

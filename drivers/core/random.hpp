// SPDX-License-Identifier: MIT
// Reproducible random numbers. A pair (seed, stream) always gives the same sequence, on any thread
// and in any order of the streams.
#pragma once
#include <cstdint>
#include <random>

namespace echofuse {

// One step of SplitMix64 (Steele, Lea, Flood 2014). Maps neighbouring seeds to unrelated values.
inline std::uint64_t mix(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

using Rng = std::mt19937_64;
inline Rng make_rng(std::uint64_t seed, std::uint64_t stream) {
  return Rng(mix(seed ^ mix(stream)));
}

}  // namespace echofuse

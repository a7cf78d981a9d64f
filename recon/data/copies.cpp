// SPDX-License-Identifier: MIT
#include "recon/data/copies.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t parts = 4;
constexpr unsigned bits = 16;
constexpr std::uint64_t dimmest = 64;  // bins with a smaller fraction of the highest are not used

// Variant of the FNV-1a hash that processes 32-bit words instead of bytes.
struct Hash {
  std::uint64_t value = 0xcbf29ce484222325;
  void add(std::uint32_t word) {
    value = (value ^ word) * 0x100000001b3;
    value ^= value >> 32;
  }
};

std::int64_t joined(const std::array<Hash, parts>& hashes) {
  std::uint64_t all = 0;
  for (const Hash& hash : hashes) all = all << bits | (hash.value & 0xffff);
  return std::bit_cast<std::int64_t>(all);
}

// The fingerprint without the hash of one part.
std::uint64_t key_of(std::int64_t fingerprint, std::size_t part) {
  const unsigned shift = bits * static_cast<unsigned>(part);
  return (std::bit_cast<std::uint64_t>(fingerprint) & ~(0xffffull << shift)) | part << shift;
}

// Bins and counts from which a fingerprint is computed. Positions are relative to the highest bin.
struct Bins {
  std::vector<std::pair<std::int32_t, std::uint32_t>> counts;

  // Logarithm of the probability that the counts of another record of the same scene are equal: two
  // Poisson counts of mean n are equal with probability 1 / (2 sqrt(pi n)). Counts equal to the
  // highest may be clipped.
  double log_chance(std::uint32_t top) const {
    double out = 0;
    for (const auto& [at, n] : counts)
      if (n < top) out -= std::log(4 * M_PI * static_cast<double>(n)) / 2;
    return out;
  }
  Hash hash() const {
    std::uint32_t unit = 0;
    for (const auto& [at, n] : counts) unit = std::gcd(unit, n);
    Hash out;
    for (const auto& [at, n] : counts) out.add(static_cast<std::uint32_t>(at)), out.add(n / unit);
    return out;
  }
};

}  // namespace

std::int64_t fingerprint_of(const record::FusedRecord& r) {
  // Minimum number of clicks above the background.
  constexpr double min_clicks = 100;
  constexpr double max_log_chance = -30;
  std::array<Hash, parts> hashes;
  if (!r.has(Sensor::spd)) {
    for (std::size_t i = 0; i < r.radar.size(); ++i)
      hashes[i % parts].add(std::bit_cast<std::uint32_t>(r.radar[i]));
    return r.radar.size() < parts ? 0 : joined(hashes);
  }
  const auto first = std::ranges::find_if(r.spd, [](auto n) { return n > 0; });
  const auto last = std::find_if(r.spd.rbegin(), r.spd.rend(), [](auto n) { return n > 0; });
  if (first == r.spd.end()) return 0;
  std::vector<float> values(first, last.base());
  const double clicks = std::accumulate(values.begin(), values.end(), 0.0);
  const double background = double{quantile(values, 0.5)} * static_cast<double>(values.size());
  if (clicks - background < min_clicks) return 0;
  const auto top = std::ranges::max_element(r.spd);
  Bins all, bright;
  std::array<Bins, parts> quarters;
  for (auto n = first; n != last.base(); ++n) {
    const std::pair bin(static_cast<std::int32_t>(n - top), *n);
    if (*n > 0) all.counts.push_back(bin);
    if (*n == 0 || *n * dimmest < *top) continue;
    bright.counts.push_back(bin);
    quarters[static_cast<std::size_t>(n - top) % parts].counts.push_back(bin);
  }
  double sum = 0, lowest = 0;
  for (std::size_t k = 0; k < parts; ++k) {
    const double chance = quarters[k].log_chance(*top);
    sum += chance, lowest = std::min(lowest, chance);
    hashes[k] = quarters[k].hash();
  }
  if (sum - lowest <= max_log_chance) return joined(hashes);
  // The return is too narrow for four parts.
  for (const Bins& bins : {bright, all})
    if (bins.log_chance(*top) <= max_log_chance)
      return std::bit_cast<std::int64_t>(bins.hash().value);
  return 0;
}

std::size_t Copies::first(std::int64_t fingerprint, std::size_t row) {
  if (fingerprint == 0) return row;
  std::size_t out = row;
  for (std::size_t part = 0; part < parts; ++part)
    out = std::min(out, rows_.emplace(key_of(fingerprint, part), row).first->second);
  return out;
}

bool Copies::contains(std::int64_t fingerprint) const {
  for (std::size_t part = 0; part < parts; ++part)
    if (fingerprint != 0 && rows_.contains(key_of(fingerprint, part))) return true;
  return false;
}

}  // namespace echofuse::recon

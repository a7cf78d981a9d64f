// SPDX-License-Identifier: MIT
#include "recon/data/copies.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>
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

}  // namespace

std::int64_t fingerprint_of(const record::FusedRecord& r) {
  // Minimum number of clicks above the background.
  constexpr double min_clicks = 100;
  constexpr double max_log_chance = -30;
  std::array<Hash, parts> hashes;
  if (!r.has(Sensor::spd)) {
    for (std::size_t i = 0; i < r.radar.size(); ++i)
      hashes[i % parts].add(std::bit_cast<std::uint32_t>(r.radar[i]));
    return r.radar.empty() ? 0 : joined(hashes);
  }
  const auto first = std::ranges::find_if(r.spd, [](auto n) { return n > 0; });
  const auto last = std::find_if(r.spd.rbegin(), r.spd.rend(), [](auto n) { return n > 0; });
  if (first == r.spd.end()) return 0;
  std::vector<float> values(first, last.base());
  const double clicks = std::accumulate(values.begin(), values.end(), 0.0);
  const double background = double{quantile(values, 0.5)} * static_cast<double>(values.size());
  if (clicks - background < min_clicks) return 0;
  const auto top = std::ranges::max_element(r.spd) - r.spd.begin();
  const auto used = [&](std::uint32_t n) {
    return n > 0 && n * dimmest >= r.spd[static_cast<std::size_t>(top)];
  };
  std::array<std::uint32_t, parts> unit{};
  // Logarithm of the probability that the counts of another record of the same scene are equal: two
  // Poisson counts of mean n are equal with probability 1 / (2 sqrt(pi n)).
  std::array<double, parts> log_chance{};
  const auto part_of = [&](std::ptrdiff_t bin) {
    return static_cast<std::size_t>(bin - top) % parts;
  };
  for (std::ptrdiff_t i = 0; i < std::ssize(r.spd); ++i)
    if (const auto n = r.spd[static_cast<std::size_t>(i)]; used(n)) {
      unit[part_of(i)] = std::gcd(unit[part_of(i)], n);
      log_chance[part_of(i)] -= std::log(4 * M_PI * static_cast<double>(n)) / 2;
    }
  const double sum = std::accumulate(log_chance.begin(), log_chance.end(), 0.0);
  if (sum - std::ranges::min(log_chance) > max_log_chance) return 0;
  for (std::ptrdiff_t i = 0; i < std::ssize(r.spd); ++i)
    if (const auto n = r.spd[static_cast<std::size_t>(i)]; used(n)) {
      hashes[part_of(i)].add(static_cast<std::uint32_t>(i - top));
      hashes[part_of(i)].add(n / unit[part_of(i)]);
    }
  return joined(hashes);
}

std::size_t Copies::first(std::int64_t fingerprint, std::size_t row) {
  if (fingerprint == 0) return row;
  for (std::size_t part = 0; part < parts; ++part)
    if (const auto found = rows_.find(key_of(fingerprint, part)); found != rows_.end())
      return found->second;
  for (std::size_t part = 0; part < parts; ++part) rows_.emplace(key_of(fingerprint, part), row);
  return row;
}

bool Copies::contains(std::int64_t fingerprint) const {
  for (std::size_t part = 0; part < parts; ++part)
    if (fingerprint != 0 && rows_.contains(key_of(fingerprint, part))) return true;
  return false;
}

}  // namespace echofuse::recon

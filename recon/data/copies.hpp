// SPDX-License-Identifier: MIT
// Finds copies of records by their photon counts.
//
// A fingerprint consists of four hashes of 16 bits, each computed from every fourth bin that has at
// least 1/64 of the highest: positions relative to the highest bin, and counts divided by their
// greatest common divisor. Records are copies of each other if three of the four hashes are equal.
// Counts that were shifted, padded with zeros, multiplied by an integer, or changed in a bin other
// than the highest are therefore recognised. Different counts have three equal hashes with
// probability 4 * 2^-48. If the return is too narrow for four parts, the fingerprint is one
// hash, which does not recognise counts with a changed bin.
#pragma once
#include <cstddef>
#include <cstdint>
#include <unordered_map>

#include "acquire/record/fused_record.hpp"

namespace echofuse::recon {

// Returns the fingerprint of the SPD counts, or of the radar values if the SPD is missing. Returns
// 0 (no fingerprint) if another record of the same scene could have equal counts by chance.
std::int64_t fingerprint_of(const record::FusedRecord& record);

class Copies {
 public:
  // Adds a record, and returns the lowest row of its copies, or `row` if there are none. Rows must
  // be added in increasing order.
  std::size_t first(std::int64_t fingerprint, std::size_t row);
  bool contains(std::int64_t fingerprint) const;

 private:
  std::unordered_map<std::uint64_t, std::size_t> rows_;  // keys: any three hashes of a fingerprint
};

}  // namespace echofuse::recon

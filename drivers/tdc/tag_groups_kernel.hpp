// SPDX-License-Identifier: MIT
// Implementation of count_groups() for one instruction set. tag_groups.cpp includes this file once
// per instruction set. Therefore this file must not have an include guard. Do not call functions of
// std here: the linker could use code for one instruction set on processors that do not support it.
#include <hwy/highway.h>

#include <bit>

#include "drivers/tdc/tag_groups.hpp"

HWY_BEFORE_NAMESPACE();
namespace echofuse::tdc::HWY_NAMESPACE {

#if HWY_MAX_BYTES >= 32 && !HWY_HAVE_SCALABLE

namespace hn = hwy::HWY_NAMESPACE;
using Times = hn::CappedTag<std::uint64_t, max_group>;
using Bins = hn::Rebind<std::int32_t, Times>;
constexpr std::size_t group = hn::MaxLanes(Times());
constexpr unsigned sets = 1u << group;  // number of subsets of lanes

// Table of permutations with one row for each subset of lanes. A vector is divided into pieces of
// size `bytes`; the row contains the source index of each piece. AVX2 can move 4-byte pieces across
// the whole vector, but single bytes only within 16 bytes.
template <std::size_t bytes, std::size_t lane_bytes, unsigned rows>
struct Permutations {
  static constexpr unsigned pieces = lane_bytes / bytes;
  std::uint8_t from[rows][group * pieces];
  template <class Source>
  constexpr explicit Permutations(const Source& lane_for) : from() {
    for (unsigned set = 0; set < rows; ++set)
      for (unsigned to = 0; to < group * pieces; ++to)
        from[set][to] =
            static_cast<std::uint8_t>(lane_for(set, to / pieces) * pieces + to % pieces);
  }
};

// Source index of each lane: the last lane of the subset at or before this lane; arbitrary if the
// subset has no such lane.
alignas(64) constexpr Permutations<4, 8, sets> last_of([](unsigned set, unsigned lane) {
  const unsigned upto = set & ((2u << lane) - 1);
  return upto == 0 ? 0u : static_cast<unsigned>(std::bit_width(upto)) - 1;
});
// Source index of each lane: the preceding lane. The source of the first lane is the last lane.
alignas(64) constexpr Permutations<4, 8, 1> before([](unsigned, unsigned lane) {
  return (lane + group - 1) % group;
});
alignas(64) constexpr Permutations<4, 8, 1> last([](unsigned, unsigned) { return group - 1; });

HWY_INLINE hn::Vec<Times> permute(hn::Vec<Times> lanes, const std::uint8_t* from) {
  const hn::Repartition<std::uint32_t, Times> d32;
  const hn::Rebind<std::uint8_t, decltype(d32)> d8;
  const auto indices = hn::IndicesFromVec(d32, hn::PromoteTo(d32, hn::Load(d8, from)));
  return hn::BitCast(Times(), hn::TableLookupLanes(hn::BitCast(d32, lanes), indices));
}

HWY_INLINE unsigned set_of(hn::Mask<Times> lanes) {
  std::uint8_t bits[8] = {};  // at least 8 bytes, as Highway requires
  hn::StoreMaskBits(Times(), lanes, bits);
  return bits[0];
}

HWY_INLINE hn::Mask<Times> mask_of(unsigned set) {
  const std::uint8_t bits[8] = {static_cast<std::uint8_t>(set)};
  return hn::LoadMaskBits(Times(), bits);
}

// Moves the bins in the subset's lanes to the front. The contents of the other lanes are arbitrary.
HWY_INLINE hn::Vec<Bins> pack(hn::Vec<Bins> bins, unsigned set) {
#if HWY_TARGET <= HWY_AVX3
  const std::uint8_t bits[8] = {static_cast<std::uint8_t>(set)};
  return hn::CompressBits(bins, bits);
#else  // same result as CompressBits, for which GCC 12 copies a table to the stack on each call
  alignas(64) static constexpr Permutations<1, 4, sets> packed([](unsigned lanes, unsigned lane) {
    for (; lane > 0; --lane) lanes &= lanes - 1;
    return lanes == 0 ? 0u : static_cast<unsigned>(std::countr_zero(lanes));
  });
  const hn::Repartition<std::uint8_t, Bins> d8;
  return hn::TableLookupBytes(bins, hn::BitCast(Bins(), hn::Load(d8, packed.from[set])));
#endif
}

constexpr std::size_t chunk = 2048;

// Prefetches the next page explicitly, because the processor's prefetcher stops at page boundaries.
HWY_INLINE void prefetch_next_page(const Tag* tags) {
  const auto ahead = reinterpret_cast<std::uintptr_t>(tags) + 4096;
  for (std::size_t i = 0; i < group * sizeof(Tag); i += 64)
    __builtin_prefetch(reinterpret_cast<const void*>(ahead + i));
}

std::size_t take_groups(const Tag* tags, std::size_t count, const ClickBins& bins, TagRun& run,
                        std::uint32_t* cells) {
  const Times d;
  const hn::Rebind<double, Times> df;
  const auto word_of = [&d](std::int32_t channel) {
    return hn::Set(d, std::uint64_t{static_cast<std::uint32_t>(channel)} << 32);
  };
  const auto start_word = word_of(bins.start_channel), click_word = word_of(bins.click_channel);
  // bit masks for the channel, and for the type together with the reserved byte
  const auto channel_bits = word_of(-1), head_bits = hn::Set(d, 0xffff);
  const auto first_bin = hn::Set(d, bins.first_bin_ps), range = hn::Set(d, bins.range_ps);
  // The bitwise OR of an integer and the double 2^52 is the double 2^52 + integer.
  const auto two_52 = hn::Set(d, 0x4330000000000000);
  const auto two_52_less_half = hn::Set(df, 0x1p52 - 0.5);
  const auto bins_per_ps = hn::Set(df, bins.bins_per_ps);
  const auto first_lane = hn::FirstN(d, 1);
  auto start = hn::Set(d, run.last_start_ps);    // all lanes contain the same time
  auto previous = hn::Set(d, run.last_time_ps);  // only the first lane is used
  auto backwards = hn::Zero(d);
  std::size_t taken = 0, starts = 0, all_clicks = 0;
  bool sound = true;
  while (sound && count - taken >= group) {
    HWY_ALIGN std::int32_t clicked[chunk + group];  // bins of the clicks in this chunk
    std::size_t clicks = 0;
    const std::size_t end = taken + HWY_MIN(chunk, (count - taken) / group * group);
    for (; taken < end; taken += group) {
      prefetch_next_page(tags + taken);
      hn::Vec<Times> word, time;
      hn::LoadInterleaved2(d, reinterpret_cast<const std::uint64_t*>(tags + taken), word, time);
      sound = hn::AllTrue(d, hn::Eq(hn::And(word, head_bits), hn::Zero(d)));
      if (HWY_UNLIKELY(!sound)) break;

      const auto moved = permute(time, before.from[0]);
      const auto step = hn::Sub(time, hn::IfThenElse(first_lane, previous, moved));
      backwards = hn::Add(backwards, hn::ShiftRight<63>(step));
      previous = moved;

      const auto channel = hn::And(word, channel_bits);
      const unsigned start_set = set_of(hn::Eq(channel, start_word));
      const unsigned click_set = set_of(hn::Eq(channel, click_word));
      const auto before_first = mask_of((start_set & -start_set) - 1);
      start = hn::IfThenElse(before_first, start, permute(time, last_of.from[start_set]));
      const auto distance = hn::Min(hn::Sub(hn::Sub(time, start), first_bin), range);
      start = permute(start, last.from[0]);
      const auto number = hn::Sub(hn::BitCast(df, hn::Or(distance, two_52)), two_52_less_half);
      const auto bin = hn::DemoteTo(Bins(), hn::Mul(number, bins_per_ps));
      hn::StoreU(pack(bin, click_set), Bins(), clicked + clicks);
      clicks += hwy::PopCount(click_set);
      starts += hwy::PopCount(start_set);
    }
    for (std::size_t i = 0; i < clicks; ++i) ++cells[clicked[i]];
    all_clicks += clicks;
  }
  run.starts += starts;
  run.others += taken - starts - all_clicks;
  run.backwards += hn::GetLane(hn::SumOfLanes(d, backwards));
  run.last_start_ps = hn::GetLane(start);
  run.last_time_ps = hn::GetLane(previous);
  return taken;
}

// Compares whole vectors of tags, from the second tag on, with their predecessors. Sets `odd` if
// one is earlier or not a time tag. Returns the number of tags that need no further check.
HWY_INLINE std::size_t check_groups(const Tag* tags, std::size_t count, bool& odd) {
  const hn::ScalableTag<std::uint64_t> d;
  constexpr std::size_t tags_a_vector = hn::MaxLanes(d) / 2;
  auto steps = hn::Zero(d), heads = hn::Zero(d);
  std::size_t at = 1;
  for (; at + tags_a_vector <= count; at += tags_a_vector) {
    const auto* const words = reinterpret_cast<const std::uint64_t*>(tags + at);
    const auto here = hn::LoadU(d, words), before = hn::LoadU(d, words - 2);
    heads = hn::Or(heads, here);
    steps = hn::Or(steps, hn::Sub(here, before));
  }
  // The even lanes contain the type and the reserved byte, the odd lanes the times.
  odd |= !hn::AllTrue(
      d, hn::Eq(hn::OddEven(hn::ShiftRight<63>(steps), hn::And(heads, hn::Set(d, 0xffff))),
                hn::Zero(d)));
  return at;
}

#else

HWY_INLINE std::size_t check_groups(const Tag*, std::size_t, bool&) { return 1; }

std::size_t take_groups(const Tag*, std::size_t, const ClickBins&, TagRun&, std::uint32_t*) {
  return 0;
}

#endif

bool has_only_ordered_times(const Tag* tags, std::size_t count, std::uint64_t before_ps) {
  bool odd = false;
  const auto check = [&](const Tag& tag) {
    const auto time = static_cast<std::uint64_t>(tag.time_ps);
    odd |= static_cast<std::int64_t>(time - before_ps) < 0 || !tag.is_time_tag();
  };
  check(tags[0]);
  for (std::size_t i = check_groups(tags, count, odd); i < count; ++i) {
    before_ps = static_cast<std::uint64_t>(tags[i - 1].time_ps);
    check(tags[i]);
  }
  return !odd;
}

}  // namespace echofuse::tdc::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

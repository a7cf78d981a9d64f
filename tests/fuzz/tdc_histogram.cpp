// SPDX-License-Identifier: MIT
// Input: i32 start channel, i32 click channel, i64 bin width, i64 first bin, u32 number of bins,
// then tags in wire format. Compares the histogram, with every instruction set of this processor,
// with a reference that counts tag by tag. Checks the counts of the tag filter.
#include <hwy/highway.h>

#include "../drivers/tag_reference.hpp"
#include "drivers/util/exit_code.hpp"
#include "fuzz.hpp"

using namespace echofuse::tdc;

namespace {

// A larger number of bins would only slow down the fuzzer.
constexpr std::uint32_t max_bins = 1u << 14;

bool allowed(const HistogramSettings& s) {
  return s.bins >= 1 && s.bins <= 1u << 24 && s.bin_width_ps >= 1 &&
         s.start_channel != s.click_channel &&
         static_cast<double>(s.bin_width_ps) * s.bins <= 0x1p50;
}

}  // namespace

void fuzz::run(ByteView input) {
  ByteReader in(input);
  HistogramSettings s;
  s.start_channel = in.get<std::int32_t>();
  s.click_channel = in.get<std::int32_t>();
  s.bin_width_ps = in.get<std::int64_t>();
  s.first_bin_ps = in.get<std::int64_t>();
  s.bins = in.get<std::uint32_t>();
  if (!in.ok() || (s.bins > max_bins && allowed(s))) return;
  const auto tags = to_values<Tag>(in.take(in.left()));
  try {
    Histogram pieces(s);
    require(allowed(s), "bad settings are refused");
    const test::TagReference reference(s, tags);
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
      hwy::GetChosenTarget().Update(target);
      Histogram whole(s);
      whole.add(tags);
      require(whole.counts() == reference.counts, "every click is in its bin");
      require(whole.tag_counts() == reference.n, "every tag is counted in exactly one category");
    }

    std::uint64_t in_slots = 0;
    for (std::size_t i = 0; i < tags.size(); ++i) {
      pieces.add(std::span(tags).subspan(i, 1));
      const std::uint64_t in_range = pieces.tag_counts().in_range;
      std::uint64_t sum = 0;
      for (const std::uint32_t count : pieces.take()) sum += count;
      require(sum == in_range, "a slot's bins add up to its clicks in range");
      in_slots += sum;
    }
    HistogramSettings filtering = s;
    filtering.click_delay_ps = s.first_bin_ps % 1'000'000;
    filtering.dead_time_ps = s.bin_width_ps % 1'000'000;
    Histogram filtered(filtering);
    filtered.add(tags);
    filtered.flush();
    require(filtered.tag_counts().tags == tags.size(), "delays and dead time lose no tag");

    require(in_slots == reference.n.in_range, "slots of one tag sum to one long slot");
  } catch (const Error& error) {
    require(error.code() == ExitCode::config && !allowed(s), "valid settings are accepted");
  }
}

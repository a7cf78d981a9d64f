// SPDX-License-Identifier: MIT
// Tags -> filter -> histogram: every tag is in exactly one count, however the stream is cut.
#include <numeric>

#include "drivers/tdc/histogram.hpp"
#include "drivers/tdc/tag_filter.hpp"
#include "fuzz.hpp"

using namespace echofuse;
using namespace echofuse::fuzz;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ByteReader in({data, size});
  const auto cut = in.get<std::uint8_t>();
  const auto start_delay = in.get<std::int16_t>(), click_delay = in.get<std::int16_t>();
  const auto dead_time = in.get<std::uint16_t>();
  const auto tags = to_values<Tag>(in.take(in.left()));
  tdc::TagFilter filter(
      {.start_delay_ps = start_delay, .click_delay_ps = click_delay, .dead_time_ps = dead_time});
  tdc::Histogram histogram({.bin_width_ps = 7, .first_bin_ps = -20, .bins = 33});
  std::span<const Tag> rest(tags);
  while (!rest.empty()) {
    const std::size_t n = std::min<std::size_t>(rest.size(), 1u + cut);
    histogram.add(filter.feed(rest.first(n)));
    rest = rest.subspan(n);
  }
  histogram.add(filter.flush());
  const std::uint64_t removed = filter.take_removed();
  require(dead_time > 0 || removed == 0, "without a dead time nothing is removed");
  const auto c = histogram.tag_counts();
  require(c.tags + removed == tags.size(), "every tag comes out or is counted as removed");
  require(c.tags == c.starts + c.in_range + c.out_of_range + c.without_start + c.other,
          "every tag is in one count");
  require(c.bad_tags <= c.other && c.overflows + c.errors <= c.other, "markers are others");
  const auto counts = histogram.counts();
  require(std::accumulate(counts.begin(), counts.end(), std::uint64_t{0}) == c.in_range,
          "the bins hold the clicks in range");
  return 0;
}

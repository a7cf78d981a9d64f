// SPDX-License-Identifier: MIT
#include "drivers/bridge_pack/bridge_pack.hpp"

#include <algorithm>

#include "drivers/core/crc32c.hpp"
#include "drivers/core/sample.hpp"

using namespace echofuse;

namespace {

// Moves the tags of these channels, and the marks of all, to the front; how many.
std::size_t keep(std::uint8_t* tags, std::size_t count, std::int32_t start, std::int32_t click) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < count; ++i) {
    Tag tag;
    std::memcpy(&tag, tags + i * sizeof tag, sizeof tag);
    const bool mark = tag.type != TagType::time_tag && tag.type < TagType::missed_events;
    std::memcpy(tags + kept * sizeof tag, &tag, sizeof tag);
    kept += mark || tag.channel == start || tag.channel == click;
  }
  return kept;
}

}  // namespace

std::uint32_t echofuse_bridge_pack_version() { return 2; }

void echofuse_pack_tags(const void* from, void* to, std::size_t count, std::int32_t start_channel,
                        std::int32_t click_channel, EchofusePacked* packed) {
  // Tags of 24 KiB: the CRC finds them in the processor's first cache.
  constexpr std::size_t piece = 1536;
  using Words [[gnu::vector_size(sizeof(Tag))]] = std::int32_t;
  const Words click{0, click_channel, 0, 0};
  const Words sought{static_cast<std::int32_t>(TagType::overflow_begin), start_channel};
  *packed = {};
  const auto* in = static_cast<const std::uint8_t*>(from);
  auto* out = static_cast<std::uint8_t*>(to);
  while (count > 0) {
    const std::size_t n = std::min(count, piece);
    // Masks of a tag's four words: the first has type and reserved byte, the second is the channel.
    Words found{}, clicks{};
    for (std::size_t i = 0; i < n; ++i) {
      Words tag;
      std::memcpy(&tag, in + i * sizeof tag, sizeof tag);
      found -= (tag & Words{0xff, -1, -1, -1}) == sought;  // true is -1
      clicks -= tag == click;
      tag &= Words{~0xff00, -1, -1, -1};
      std::memcpy(out + i * sizeof tag, &tag, sizeof tag);
    }
    const auto ours = static_cast<std::size_t>(found[1]) + static_cast<std::size_t>(clicks[1]);
    const std::size_t kept = ours == n ? n : keep(out, n, start_channel, click_channel);
    packed->overflows += static_cast<std::uint32_t>(found[0]);
    packed->starts += static_cast<std::uint32_t>(found[1]);
    packed->kept += kept;
    packed->crc = crc32c({out, kept * sizeof(Tag)}, packed->crc);
    in += n * sizeof(Tag);
    out += kept * sizeof(Tag);
    count -= n;
  }
}

std::uint32_t echofuse_crc32c(const void* bytes, std::size_t count, std::uint32_t crc) {
  return crc32c({static_cast<const std::uint8_t*>(bytes), count}, crc);
}

std::uint32_t echofuse_crc32c_join(std::uint32_t first, std::uint32_t second,
                                   std::uint64_t second_bytes) {
  return crc32c_shift(first, second_bytes) ^ second;
}

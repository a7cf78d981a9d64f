// SPDX-License-Identifier: MIT
// C functions of a shared library. scripts/bridges/pack.py loads it, because a time tagger delivers
// tags faster than Python packs them. Stateless, without errors: any bytes are valid tags.
#include <cstddef>
#include <cstdint>

#include "drivers/core/crc32c.hpp"
#include "drivers/core/sample.hpp"

using namespace echofuse;

namespace {

// Moves the tags of these channels and all markers to the front; returns their number.
std::size_t keep(std::uint8_t* tags, std::size_t count, std::int32_t start, std::int32_t click) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < count; ++i) {
    Tag tag;
    std::memcpy(&tag, tags + i * sizeof tag, sizeof tag);
    const bool marker = tag.type != TagType::time_tag && tag.type < TagType::missed_events;
    std::memcpy(tags + kept * sizeof tag, &tag, sizeof tag);
    kept += marker || tag.channel == start || tag.channel == click;
  }
  return kept;
}

}  // namespace

#pragma GCC visibility push(default)
extern "C" {

// Version of these functions; callers check for equality.
std::uint32_t echofuse_bridge_pack_version() { return 3; }

struct EchofusePacked {
  std::uint32_t kept, starts, overflows;  // counts: packed tags, start tags, overflow begins
};

// Copies the tags (drivers/core/sample.hpp) of two channels, and errors and overflows of any
// channel, with reserved byte 0. `to` must have room for all tags and not overlap `from`.
void echofuse_pack_tags(const std::uint8_t* from, std::uint8_t* to, std::uint32_t count,
                        std::int32_t start_channel, std::int32_t click_channel,
                        EchofusePacked* packed) {
  using Words [[gnu::vector_size(sizeof(Tag))]] = std::int32_t;
  const Words click{0, click_channel, 0, 0};
  const Words sought{static_cast<std::int32_t>(TagType::overflow_begin), start_channel};
  // Masks of a tag's four words: the first has type and reserved byte, the second the channel.
  Words found{}, clicks{};
  for (std::size_t i = 0; i < count; ++i) {
    Words tag;
    std::memcpy(&tag, from + i * sizeof tag, sizeof tag);
    found -= (tag & Words{0xff, -1, -1, -1}) == sought;  // true is -1
    clicks -= tag == click;
    tag &= Words{~0xff00, -1, -1, -1};
    std::memcpy(to + i * sizeof tag, &tag, sizeof tag);
  }
  const auto starts = static_cast<std::uint32_t>(found[1]);
  const bool all = starts + static_cast<std::uint32_t>(clicks[1]) == count;
  packed->kept =
      all ? count : static_cast<std::uint32_t>(keep(to, count, start_channel, click_channel));
  packed->starts = starts;
  packed->overflows = static_cast<std::uint32_t>(found[0]);
}

// Continues the CRC-32C of earlier bytes (0: none).
std::uint32_t echofuse_crc32c(const std::uint8_t* bytes, std::size_t count, std::uint32_t crc) {
  return crc32c({bytes, count}, crc);
}

}  // extern "C"
#pragma GCC visibility pop

// SPDX-License-Identifier: MIT
// C functions of a shared library that scripts/bridges/pack.py loads, because a time tagger
// delivers tags faster than Python can pack them. The functions have no state and cannot fail: they
// accept any bytes as tags.
#include <cstddef>
#include <cstdint>

#include "drivers/core/crc32c.hpp"
#include "drivers/core/sample.hpp"

using namespace echofuse;

namespace {

// Moves the tags of the start and click channels, and all markers, to the front of `tags`. Returns
// the number of tags moved.
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

// Version of this library's interface. Callers reject every version that they do not support.
std::uint32_t echofuse_bridge_pack_version() { return 3; }

struct EchofusePacked {
  // number of tags kept, number of start tags, and number of overflow_begin markers
  std::uint32_t kept, starts, overflows;
};

// Copies the tags (drivers/core/sample.hpp) of the start and click channels, and the error and
// overflow markers of all channels. Sets the reserved byte of each copy to 0. `to` must have room
// for `count` tags and must not overlap `from`.
void echofuse_pack_tags(const std::uint8_t* from, std::uint8_t* to, std::uint32_t count,
                        std::int32_t start_channel, std::int32_t click_channel,
                        EchofusePacked* packed) {
  using Words [[gnu::vector_size(sizeof(Tag))]] = std::int32_t;
  const Words click{0, click_channel, 0, 0};
  const Words sought{static_cast<std::int32_t>(TagType::overflow_begin), start_channel};
  // Counts the 32-bit words that match: `found` for overflow markers and starts, `clicks` for
  // clicks. Word 0 of a tag contains the type, word 1 the channel.
  Words found{}, clicks{};
  for (std::size_t i = 0; i < count; ++i) {
    Words tag;
    std::memcpy(&tag, from + i * sizeof tag, sizeof tag);
    // a vector comparison gives -1 for each matching word
    found -= (tag & Words{0xff, -1, -1, -1}) == sought;
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

// Continues the CRC-32C `crc` of the preceding bytes; `crc` is 0 for the first bytes.
std::uint32_t echofuse_crc32c(const std::uint8_t* bytes, std::size_t count, std::uint32_t crc) {
  return crc32c({bytes, count}, crc);
}

}  // extern "C"
#pragma GCC visibility pop

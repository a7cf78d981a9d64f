// SPDX-License-Identifier: MIT
// Bridge stream -> blocks -> hello, tags, depth: no byte is unaccounted, no block is not whole.
#include "drivers/bridge/bridge_protocol.hpp"
#include "fuzz.hpp"

using namespace echofuse;
using namespace echofuse::fuzz;

namespace {

void read_payload(ByteView payload) {
  bridge::read_hello(payload);
  std::vector<Tag> scratch;
  const auto tags = bridge::read_tags(payload, scratch);
  require(tags.has_value() == (payload.size() % sizeof(Tag) == 0), "tags are whole");
  if (tags) require(tags->size_bytes() == payload.size(), "every tag is read");
  if (const auto depth = bridge::read_depth(payload))
    require(depth->frame.depth_mm.size() == std::size_t{depth->frame.width} * depth->frame.height &&
                depth->x.count == depth->frame.width && depth->y.count == depth->frame.height,
            "a depth frame has all its pixels");
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const ByteView input(data, size);
  read_payload(input);
  bridge::BlockParser parser;
  std::uint64_t bytes = 0, blocks = 0, lost = 0;
  in_pieces(input, [&](ByteView piece) {
    parser.feed(piece, [&](const bridge::Block& block) {
      ++blocks;
      bytes += bridge::header_bytes + block.payload.size();
      lost += block.lost_blocks;
      read_payload(block.payload);
    });
  });
  parser.reset();
  const bridge::BlockCounts& c = parser.counts();
  require(c.bytes == (size > 0 ? size - 1 : 0), "every byte is counted");
  require(c.bytes == bytes + c.junk_bytes, "bytes are in a block or junk");
  require(c.blocks == blocks && c.lost_blocks == lost, "the counters are those of the blocks");
  return 0;
}

// SPDX-License-Identifier: MIT
// Input: u8 seed for the split of the stream, then the stream of blocks. A header CRC of zero is
// corrected.
#include "blocks.hpp"
#include "drivers/bridge/bridge_writer.hpp"

using namespace echofuse::bridge;

namespace {

struct Session {
  explicit Session(ByteView all) : stream(all) {}
  ByteView stream;
  BlockParser parser{};
  std::vector<Bytes> blocks{};
  std::uint64_t block_bytes = 0, lost = 0, gaps = 0;
  std::size_t searched = 0;

  void feed(ByteView bytes) {
    parser.feed(bytes, [this](const Block& block) { take(block); });
  }
  void take(const Block& block) {
    // A block has only one valid encoding.
    Bytes bytes = make_block(block.kind, block.sequence, block.dropped_items, block.payload);
    const ByteView rest = stream.subspan(searched);
    const auto at = std::search(rest.begin(), rest.end(), bytes.begin(), bytes.end());
    require(at != rest.end(), "the stream contains each block, in this order");
    searched += static_cast<std::size_t>(at - rest.begin()) + 1;
    block_bytes += bytes.size();
    lost += block.lost_blocks;
    gaps += block.lost_blocks > 0;
    blocks.push_back(std::move(bytes));
  }
  void end() {
    const bool broken = parser.broken();
    parser.reset();
    const BlockCounts& n = parser.counts();
    require(n.bytes == block_bytes + n.junk_bytes, "every byte is in a block or junk");
    require(broken ? n.bytes <= stream.size() : n.bytes == stream.size(),
            "every byte up to the damage is counted");
    require(n.bad_headers + n.bad_crcs == (broken ? 1 : 0), "the damage is counted");
    require(n.blocks == blocks.size(), "every block is delivered");
    require(n.lost_blocks == lost && n.gaps == gaps, "losses are reported with the next block");
  }
};

}  // namespace

void fuzz::run(ByteView input) {
  if (input.empty()) return;
  Bytes stream(input.begin() + 1, input.end());
  put_in_crcs(stream);
  Session whole(stream), pieces(stream);
  whole.feed(stream);
  in_pieces(stream, input[0], [&](ByteView piece) { pieces.feed(piece); });
  whole.end();
  pieces.end();
  require(whole.blocks == pieces.blocks, "any split gives the same blocks");
  require(
      std::ranges::equal(counters_of(whole.parser.counts()), counters_of(pieces.parser.counts()),
                         {}, &Counter::value, &Counter::value),
      "and the same counters");
}

// SPDX-License-Identifier: MIT
#include "drivers/bridge/bridge_protocol.hpp"

#include <array>
#include <cmath>
#include <cstring>
#include <utility>

#include "drivers/core/crc32c.hpp"

namespace echofuse::bridge {
namespace {

constexpr int most_checks = 1000;  // in one turn: a few milliseconds

constexpr std::array<std::uint8_t, 4> magic = {'E', 'F', 'B', 'R'};

struct Header {
  std::uint16_t version, kind;
  std::uint32_t sequence, payload_bytes;
  std::uint64_t dropped_items;
  std::uint32_t reserved, crc;

  bool plausible() const {
    return version == protocol_version && kind <= static_cast<std::uint16_t>(BlockKind::bye) &&
           payload_bytes <= (kind == static_cast<std::uint16_t>(BlockKind::hello)
                                 ? max_hello_bytes
                                 : max_payload_bytes) &&
           dropped_items <= max_dropped_items && reserved == 0;
  }
};

Header read_header(ByteView bytes) {
  ByteReader in(bytes.subspan(magic.size()));
  Header h{};
  h.version = in.get<std::uint16_t>();
  h.kind = in.get<std::uint16_t>();
  h.sequence = in.get<std::uint32_t>();
  h.payload_bytes = in.get<std::uint32_t>();
  h.dropped_items = in.get<std::uint64_t>();
  h.reserved = in.get<std::uint32_t>();
  h.crc = in.get<std::uint32_t>();
  return h;
}

bool starts_with_magic(ByteView bytes) {
  const std::size_t n = std::min(bytes.size(), magic.size());
  return std::equal(magic.begin(), magic.begin() + static_cast<std::ptrdiff_t>(n), bytes.begin());
}

Axis tangent_axis(const char* name, std::uint32_t count, float start, float step) {
  return {.name = name,
          .quantity = "tangent",
          .unit = "1",
          .count = count,
          .start = start,
          .step = step};
}

// A tangent of 100 is 89.4 degrees off the axis.
bool usable(const Axis& axis) {
  const double end = axis.start + axis.step * axis.count;
  return axis.count >= 1 && axis.count <= max_depth_side && std::abs(axis.start) <= 100 &&
         std::abs(end) <= 100 && std::abs(axis.step) >= 1e-6;
}

}  // namespace

void BlockParser::feed(ByteView bytes, const OnBlock& on_block) {
  counts_.bytes += bytes.size();
  checks_ = 0;
  behind_ = false;
  buffer_.feed(bytes, [&](ByteView view) { return next(view, on_block); });
}

void BlockParser::go_on(const OnBlock& on_block) {
  checks_ = 0;
  behind_ = false;
  buffer_.again([&](ByteView view) { return next(view, on_block); });
}

void BlockParser::reset() {
  counts_.junk_bytes += buffer_.held().size();
  buffer_.clear();
  behind_ = false;
  place_ = doubtful_until_ = 0;
  doubtful_.clear();
  expected_ = 0;
  missing_ = 0;
  recent_ = {};
}

void BlockParser::give_up(const OnBlock& on_block) {
  if (buffer_.held().size() < header_bytes) return;
  const Bytes held(buffer_.held().begin(), buffer_.held().end());
  buffer_.clear();
  ++counts_.bad_headers;
  checks_ = 0;
  behind_ = false;
  const std::size_t skipped = skip_junk(held).used;
  place_ += skipped;
  const ByteView rest = ByteView(held).subspan(skipped);
  buffer_.feed(rest, [&](ByteView view) { return next(view, on_block); });
}

Step BlockParser::next(ByteView bytes, const OnBlock& on_block) {
  const Step step = judge(bytes, on_block);
  place_ += step.used;
  return step;
}

Step BlockParser::judge(ByteView bytes, const OnBlock& on_block) {
  if (!bytes.empty() && !starts_with_magic(bytes)) return skip_junk(bytes);
  if (bytes.size() < header_bytes) return {0, header_bytes};
  behind_ = checks_ == most_checks;
  if (behind_) return {0, 0};
  ++checks_;
  const Header header = read_header(bytes);
  if (!header.plausible()) {
    ++counts_.bad_headers;
    return skip_junk(bytes);
  }
  const std::size_t size = header_bytes + header.payload_bytes;
  if (bytes.size() < size) return {0, size};
  const ByteView payload = bytes.subspan(header_bytes, header.payload_bytes);
  if (crc_of(bytes.first(size)) != header.crc) {
    doubtful_until_ = std::max(doubtful_until_, place_ + size);
    ++counts_.bad_crcs;
    return skip_junk(bytes);
  }
  ++counts_.blocks;
  if (seen_before(header.sequence, header.crc)) {
    ++counts_.duplicates;
    return {size, 0};
  }
  Block block{.kind = static_cast<BlockKind>(header.kind),
              .sequence = header.sequence,
              .dropped_items = header.dropped_items,
              .payload = payload};
  place(block);
  on_block(block);
  return {size, 0};
}

// What an unsound block held is a part of many, if its sender wants it so.
std::uint32_t BlockParser::crc_of(ByteView block) {
  const std::uint32_t crc = crc32c(block.first(header_bytes - 4));
  if (place_ >= doubtful_until_) return crc32c(block.subspan(header_bytes), crc);
  return doubtful_.of(block, place_, header_bytes, block.size() - header_bytes, crc);
}

// From the byte after the first to where a magic stands, or where the end may hold half of one.
Step BlockParser::skip_junk(ByteView bytes) {
  auto at = std::min<std::size_t>(1, bytes.size());
  while (at < bytes.size() && !starts_with_magic(bytes.subspan(at))) {
    const void* const next = std::memchr(bytes.data() + at + 1, magic[0], bytes.size() - at - 1);
    at = next ? static_cast<std::size_t>(static_cast<const std::uint8_t*>(next) - bytes.data())
              : bytes.size();
  }
  counts_.junk_bytes += at;
  return {at, 0};
}

// A sender that numbers its blocks anew would hardly meet the same CRC.
bool BlockParser::seen_before(std::uint32_t sequence, std::uint32_t crc) {
  const std::uint64_t key = std::uint64_t{sequence} << 32 | crc;
  return std::exchange(recent_[sequence % recent_.size()], key) == key;
}

// In the sequence.
void BlockParser::place(Block& block) {
  const std::uint32_t ahead = block.sequence - expected_, back = ~ahead;
  if (back < 64 && (missing_ >> back & 1)) {
    missing_ ^= std::uint64_t{1} << back;
    block.found_blocks = 1;
    ++counts_.out_of_order;
    --counts_.lost_blocks;
    return;
  }
  expected_ = block.sequence + 1;
  if (ahead > UINT32_MAX / 2) {  // renumbered: how many are lost is unknown
    block.lost_blocks = 1;
    missing_ = 0;
  } else {
    block.lost_blocks = ahead;
    missing_ = ahead >= 63 ? ~std::uint64_t{1}
                           : missing_ << (ahead + 1) | ((std::uint64_t{1} << ahead) - 1) << 1;
  }
  counts_.gaps += block.lost_blocks > 0;
  counts_.lost_blocks += block.lost_blocks;
}

std::optional<std::span<const Tag>> read_tags(ByteView payload, std::vector<Tag>& scratch) {
  if (payload.size() % sizeof(Tag) != 0) return std::nullopt;
  const std::size_t count = payload.size() / sizeof(Tag);
  if (reinterpret_cast<std::uintptr_t>(payload.data()) % alignof(Tag) == 0)
    return std::span(reinterpret_cast<const Tag*>(payload.data()), count);
  scratch.resize(count);
  if (count) std::memcpy(scratch.data(), payload.data(), payload.size());
  return std::span<const Tag>(scratch);
}

std::optional<DepthPayload> read_depth(ByteView payload) {
  ByteReader in(payload);
  DepthPayload out;
  DepthFrame& frame = out.frame;
  frame.width = in.get<std::uint32_t>();
  frame.height = in.get<std::uint32_t>();
  frame.device_time_us = in.get<std::uint64_t>();
  frame.frame_index = in.get<std::uint32_t>();
  std::array<float, 4> axes{};
  for (float& value : axes) value = in.get<float>();
  const std::uint64_t pixels = std::uint64_t{frame.width} * frame.height;
  if (!in.ok() || pixels > max_payload_bytes || in.left() != 2 * pixels) return std::nullopt;
  out.x = tangent_axis("depth_x", frame.width, axes[0], axes[1]);
  out.y = tangent_axis("depth_y", frame.height, axes[2], axes[3]);
  if (!usable(out.x) || !usable(out.y)) return std::nullopt;
  frame.depth_mm = to_values<std::uint16_t>(in.take(in.left()));
  return out;
}

}  // namespace echofuse::bridge

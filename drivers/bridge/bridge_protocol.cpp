// SPDX-License-Identifier: MIT
#include "drivers/bridge/bridge_protocol.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "drivers/core/crc32c.hpp"

namespace echofuse::bridge {
namespace {

constexpr std::array<std::uint8_t, 4> magic = {'E', 'F', 'B', 'R'};

struct BlockHeader {
  std::uint16_t version, kind;
  std::uint32_t sequence, payload_bytes;
  std::uint64_t dropped_items;
  std::uint32_t reserved, crc;

  // Returns nullptr if the header is valid.
  const char* fault() const {
    const bool hello = kind == static_cast<std::uint16_t>(BlockKind::hello);
    if (version != protocol_version) return "wrong block header: the protocol version is not 1";
    if (kind > static_cast<std::uint16_t>(BlockKind::range_profile))
      return "wrong block header: the block kind is not 0 to 5";
    if (payload_bytes > (hello ? max_hello_bytes : max_payload_bytes))
      return "wrong block header: the payload exceeds 16 MiB (hello: 64 KiB)";
    if (dropped_items > max_dropped_items)
      return "wrong block header: more than 2^40 dropped items";
    return reserved == 0 ? nullptr : "wrong block header: the reserved field is not 0";
  }
};

BlockHeader read_header(ByteView bytes) {
  ByteReader in(bytes.subspan(magic.size()));
  BlockHeader h{};
  h.version = in.get<std::uint16_t>();
  h.kind = in.get<std::uint16_t>();
  h.sequence = in.get<std::uint32_t>();
  h.payload_bytes = in.get<std::uint32_t>();
  h.dropped_items = in.get<std::uint64_t>();
  h.reserved = in.get<std::uint32_t>();
  h.crc = in.get<std::uint32_t>();
  return h;
}

std::size_t next_magic(ByteView bytes, std::size_t from) {
  const auto found = std::search(bytes.begin() + static_cast<std::ptrdiff_t>(from), bytes.end(),
                                 magic.begin(), magic.end());
  return static_cast<std::size_t>(found - bytes.begin());
}

bool has_crc(ByteView bytes, const BlockHeader& header) {
  const ByteView payload = bytes.subspan(header_bytes, header.payload_bytes);
  return crc32c(payload, crc32c(bytes.first(header_bytes - 4))) == header.crc;
}

// Returns true if a valid block begins after byte `from`. Otherwise, sets `from` to the byte before
// the first place at which a block may begin once there are more bytes.
bool contains_block(ByteView bytes, std::size_t& from) {
  std::size_t next = bytes.size() - magic.size();
  for (std::size_t at = from; (at = next_magic(bytes, at + 1)) < bytes.size();) {
    const ByteView rest = bytes.subspan(at);
    const bool whole_header = rest.size() >= header_bytes;
    const BlockHeader header = whole_header ? read_header(rest) : BlockHeader{};
    if (whole_header && header.fault()) continue;
    if (!whole_header || header_bytes + header.payload_bytes > rest.size())
      next = std::min(next, at - 1);
    else if (has_crc(rest, header))
      return true;
  }
  from = next;
  return false;
}

// Rejects axes with tangents above 100, i.e. angles of more than 89.4 degrees from the optical
// axis.
bool usable(const Axis& axis) {
  const double end = axis.start + axis.step * axis.count;
  return axis.count >= 1 && axis.count <= max_depth_side && std::abs(axis.start) <= 100 &&
         std::abs(end) <= 100 && std::abs(axis.step) >= 1e-6;
}

Failure fault(std::string what) {
  return {std::make_error_code(std::errc::bad_message), std::move(what)};
}

Failure wrong_size(ByteView payload) {
  return fault("a size of " + std::to_string(payload.size()) +
               " bytes, which their header contradicts");
}

}  // namespace

void BlockParser::feed(ByteView bytes, const OnBlock& on_block) {
  buffer_.feed(bytes, [&](ByteView view) { return broken_ ? Step{} : next(view, on_block); });
}

void BlockParser::reset(bool recorded) {
  if (!broken_) discard(buffer_.held().size());
  buffer_.clear();
  broken_ = nullptr;
  expected_ = 0;
  searched_ = 0;
  recorded_ = recorded;
}

Step BlockParser::next(ByteView bytes, const OnBlock& on_block) {
  const auto [end, differs] = std::mismatch(magic.begin(), magic.end(), bytes.begin(), bytes.end());
  if (end != magic.end() && differs != bytes.end()) {
    ++counts_.bad_headers;
    return refuse("the received bytes are not a bridge block; expected an echofuse bridge", bytes,
                  static_cast<std::size_t>(differs - bytes.begin()) + 1);
  }
  // The magic number is compared even if it is incomplete, so that data from another protocol are
  // reported at the first wrong byte.
  if (bytes.size() < magic.size()) return {0, bytes.size() + 1};
  if (bytes.size() < header_bytes) return {0, header_bytes};
  const BlockHeader header = read_header(bytes);
  if (const char* fault = header.fault()) {
    ++counts_.bad_headers;
    return refuse(fault, bytes, header_bytes);
  }
  const std::size_t size = header_bytes + header.payload_bytes;
  // A valid block inside this one shows that its size is damaged.
  const bool overtaken = recorded_ && bytes.size() < size && contains_block(bytes, searched_);
  if (bytes.size() < size && !overtaken) return {0, recorded_ ? 0 : size};
  if (overtaken || !has_crc(bytes, header)) {
    ++counts_.bad_crcs;
    return refuse("the block has a wrong checksum", bytes, size);
  }
  counts_.bytes += size;
  ++counts_.blocks;
  searched_ = 0;
  on_block({.kind = static_cast<BlockKind>(header.kind),
            .sequence = header.sequence,
            .dropped_items = header.dropped_items,
            .lost_blocks = missing_before(header.sequence),
            .payload = bytes.subspan(header_bytes, header.payload_bytes)});
  return {size, 0};
}

// `wrong`: number of bytes of the invalid block.
Step BlockParser::refuse(const char* why, ByteView bytes, std::size_t wrong) {
  if (recorded_) {  // the last bytes may be the beginning of a magic number
    const std::size_t next = next_magic(bytes, 1), kept = magic.size() - 1;
    const std::size_t skipped =
        next < bytes.size() ? next
                            : std::max<std::size_t>(1, bytes.size() - std::min(kept, bytes.size()));
    discard(skipped);
    searched_ = 0;
    return {skipped, 0};
  }
  discard(wrong);
  broken_ = why;
  return {};
}

void BlockParser::discard(std::size_t bytes) {
  counts_.bytes += bytes;
  counts_.junk_bytes += bytes;
}

// Returns the number of blocks lost before this one. Returns 1 if the sequence number has
// decreased, because the actual number is then unknown.
std::uint64_t BlockParser::missing_before(std::uint32_t sequence) {
  const std::uint32_t ahead = sequence - expected_;
  expected_ = sequence + 1;
  const std::uint64_t lost = ahead > UINT32_MAX / 2 ? 1 : ahead;
  counts_.gaps += lost > 0;
  counts_.lost_blocks += lost;
  return lost;
}

Result<std::span<const Tag>> read_tags(ByteView payload, std::vector<Tag>& scratch) {
  if (payload.size() % sizeof(Tag) != 0) return fault("a size that is not a multiple of 16 bytes");
  const std::size_t count = payload.size() / sizeof(Tag);
  if (reinterpret_cast<std::uintptr_t>(payload.data()) % alignof(Tag) == 0)
    return std::span(reinterpret_cast<const Tag*>(payload.data()), count);
  scratch.resize(count);
  if (count) std::memcpy(scratch.data(), payload.data(), payload.size());
  return std::span<const Tag>(scratch);
}

Result<DepthPayload> read_depth(ByteView payload) {
  ByteReader in(payload);
  DepthPayload out;
  DepthFrame& frame = out.frame;
  frame.width = in.get<std::uint32_t>();
  frame.height = in.get<std::uint32_t>();
  frame.device_time_us = in.get<std::uint64_t>();
  frame.frame_number = in.get<std::uint32_t>();
  std::array<float, 4> axes{};
  for (float& value : axes) value = in.get<float>();
  const std::uint64_t pixels = std::uint64_t{frame.width} * frame.height;
  if (!in.ok() || pixels > max_payload_bytes || in.left() != 2 * pixels) return wrong_size(payload);
  out.x = tangent_axis("depth_x", frame.width, axes[0], axes[1]);
  out.y = tangent_axis("depth_y", frame.height, axes[2], axes[3]);
  if (!usable(out.x) || !usable(out.y))
    return fault("an impossible size or axis: 1 to 8192 pixels, tangents of -100 to 100");
  frame.depth_mm = to_values<std::uint16_t>(in.take(in.left()));
  return out;
}

Result<HistogramPayload> read_histogram(ByteView payload) {
  ByteReader in(payload);
  HistogramPayload out;
  HistogramFrame& frame = out.frame;
  frame.zones = in.get<std::uint32_t>();
  const auto bins = in.get<std::uint32_t>();
  frame.device_time_us = in.get<std::uint64_t>();
  frame.pulses = in.get<std::uint64_t>();
  const auto start_ps = in.get<double>(), width_ps = in.get<double>();
  frame.exposure_us = in.get<std::uint32_t>();
  if (in.ok() && (frame.zones < 1 || frame.zones > max_zones))
    return fault(std::to_string(frame.zones) + " zones; expected 1 to 64");
  if (!in.ok() || bins < 1 ||
      in.left() != sizeof(std::uint32_t) * frame.zones * std::uint64_t{bins})
    return wrong_size(payload);
  if (frame.exposure_us == 0) return fault("exposure time 0");
  if (frame.pulses > max_dropped_items) return fault("an impossible number of laser pulses");
  if (!(std::abs(start_ps) <= 1e12) || !(width_ps >= 1e-3 && width_ps <= 1e9))
    return fault("an impossible axis; expected bins of 0.001 to 1e9 ps");
  frame.counts = to_values<std::uint32_t>(in.take(in.left()));
  out.axis = spd_axis(bins, start_ps, width_ps);
  return out;
}

Result<ProfilePayload> read_profile(ByteView payload) {
  ByteReader in(payload);
  ProfilePayload out;
  RadarFrame& frame = out.frame;
  const auto bins = in.get<std::uint32_t>();
  frame.frame_number = in.get<std::uint32_t>();
  // Converts microseconds to cycles of TI's 200 MHz counter, which wraps at 2^32.
  frame.time_cpu_cycles = static_cast<std::uint32_t>(200 * in.get<std::uint64_t>());
  const auto start_m = in.get<float>(), step_m = in.get<float>();
  constexpr float farthest_m = 1e4F, min_step_m = 1e-6F;
  if (!in.ok() || in.left() != sizeof(float) * std::uint64_t{bins}) return wrong_size(payload);
  if (bins < 4) return fault(std::to_string(bins) + " bins; expected at least 4");
  if (!(std::abs(start_m) <= farthest_m) || !(step_m >= min_step_m) ||
      !(step_m * static_cast<float>(bins) <= farthest_m))
    return fault("an impossible axis; expected rising ranges of at most 10 km");
  frame.power = to_values<float>(in.take(in.left()));
  if (!std::ranges::all_of(frame.power, is_power))
    return fault("power that is not a finite number below 1e38");
  if (!std::ranges::all_of(frame.power, [](float p) { return p >= 0; }))
    return fault("power below 0: is it in dB, or was noise subtracted? Expected linear power");
  out.axis = range_axis("power", bins, start_m, step_m);
  return out;
}

std::vector<Counter> counters_of(const BlockCounts& c) {
  return {{"bytes", c.bytes},
          {"blocks", c.blocks},
          {"junk_bytes", c.junk_bytes},
          {"bad_headers", c.bad_headers},
          {"bad_crcs", c.bad_crcs},
          {"gaps", c.gaps},
          {"lost_blocks", c.lost_blocks}};
}

}  // namespace echofuse::bridge

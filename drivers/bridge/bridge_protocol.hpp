// SPDX-License-Identifier: MIT
// The wire between a vendor's own library (in a small program that serves TCP) or a device on USB
// and our drivers.
// A stream of blocks from the server; the client sends nothing. Little-endian.
//
//   off type   field
//     0 u8[4]  "EFBR"
//     4 u16    version = 1
//     6 u16    kind: 0 hello, 1 tags, 2 depth, 3 bye, 4 histogram, 5 range profile
//     8 u32    sequence: 0 for a connection's first block, +1 for each block, wraps
//    12 u32    payload bytes, at most 16 MiB; of a hello at most 64 KiB
//    16 u64    items (tags or frames) the sender dropped between the previous block and this one,
//              at most 2^40
//    24 u32    reserved = 0
//    28 u32    CRC-32C (RFC 3720) over header bytes 0..27 followed by the payload
//    32        payload
//
//   hello  UTF-8 JSON {"model": "...", "serial": "...", "firmware": "..."}; other keys are ignored.
//          The first block, and again about every second, as a heartbeat: a sender is silent for
//          at most 1 s. Blocks before a hello are not used. A detector that sends histograms adds
//          "sends": "histograms". One with several zones adds "zones", an array in the order of the
//          counts of {"x", "y", "width", "zero_ps"}: tangents of its centre, tangent of its full
//          width, and the time of range 0.
//   tags   n * 16 bytes as in drivers/core/sample.hpp; n may be 0
//   depth  u32 width, u32 height, u64 device time in us, u32 frame index,
//          f32 x_start, x_step, y_start, y_step (tangents, drivers/core/axis.hpp),
//          then width * height (at most 8192 each) u16 z in mm, row-major, top row first, 0 = no
//          measurement
//   histogram  u32 zones (1 to 64), u32 bins, u64 device time in us at the end of the exposure,
//          u64 laser pulses (0: unknown), f64 start of the first bin and f64 bin width in ps,
//          u32 exposure in us (above 0), then zones * bins u32 counts, zone after zone
//   range profile  u32 bins, u32 frame number, u64 device time in us, f32 range of the first bin
//   and
//          f32 step in m, then bins f32 of linear power (any scale)
//   bye    empty; the sender closes the connection
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/core/frame_buffer.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::bridge {

inline constexpr std::size_t header_bytes = 32;
inline constexpr std::uint32_t max_payload_bytes = 16u << 20;
inline constexpr std::uint32_t max_hello_bytes = 64u << 10;
inline constexpr std::uint64_t max_dropped_items = std::uint64_t{1} << 40;
inline constexpr std::uint16_t protocol_version = 1;

enum class BlockKind : std::uint16_t { hello, tags, depth, bye, histogram, range_profile };

struct Block {
  BlockKind kind{};
  std::uint32_t sequence = 0;
  std::uint64_t dropped_items = 0;  // dropped by the sender before this block
  std::uint64_t lost_blocks = 0;    // missing sequence numbers before this block
  ByteView payload;                 // valid only during the call
};

// bytes == bytes of blocks + junk_bytes. Excludes an incomplete block, and bytes after the damage
// that ended a connection.
struct BlockCounts {
  std::uint64_t bytes = 0, blocks = 0;
  std::uint64_t junk_bytes = 0;   // bytes of damaged or incomplete blocks
  std::uint64_t bad_headers = 0;  // wrong magic, another version, or implausible
  std::uint64_t bad_crcs = 0;
  std::uint64_t gaps = 0;         // gaps in the sequence numbers
  std::uint64_t lost_blocks = 0;  // total of missing blocks
};

std::vector<Counter> counters_of(const BlockCounts& counts);

// Parses bytes into blocks, up to the first invalid one. A connection neither loses nor reorders
// bytes. So a damaged block indicates a faulty sender, and the start of the next block is unknown.
class BlockParser {
 public:
  using OnBlock = std::function<void(const Block&)>;

  void feed(ByteView bytes, const OnBlock& on_block);
  // Returns the fault of the stream, or null. Ignores bytes after a fault.
  const char* broken() const { return broken_; }
  // Starts a connection: an incomplete block becomes junk, and the sequence starts at 0. Do not
  // call from on_block.
  void reset();
  // Frees the memory of the largest block so far, which is otherwise kept for the next one.
  void give_back() { buffer_.give_back(); }
  std::size_t kept_bytes() const { return buffer_.kept_bytes(); }
  const BlockCounts& counts() const { return counts_; }

 private:
  Step next(ByteView bytes, const OnBlock& on_block);
  Step refuse(const char* why, std::size_t bytes);
  void discard(std::size_t bytes);
  std::uint64_t missing_before(std::uint32_t sequence);

  FrameBuffer buffer_{2 * (header_bytes + max_payload_bytes)};  // a vector's capacity doubles
  const char* broken_ = nullptr;
  BlockCounts counts_;
  std::uint32_t expected_ = 0;
};

struct Hello {
  std::string model, serial, firmware;
  std::string sends;  // "histograms"; empty: tags
  Zones zones;        // empty: not stated
};
// Returns nothing for: not JSON, not an object, a known key of another type, an implausible zone,
// more than 64 KiB, 64 zones, 1024 values or 8 levels.
std::optional<Hello> read_hello(ByteView payload);

// Returns the tags in place if the payload is aligned, otherwise a copy in `scratch`. Returns
// nothing if a tag is incomplete.
std::optional<std::span<const Tag>> read_tags(ByteView payload, std::vector<Tag>& scratch);

struct DepthPayload {
  DepthFrame frame;  // without receive time and lost_before
  Axis x, y;
};
// Returns nothing if the size does not match, a side is not 1 to 8192 pixels, a tangent exceeds
// 100, or a step is below 1e-6 or not finite.
std::optional<DepthPayload> read_depth(ByteView payload);

struct HistogramPayload {
  HistogramFrame frame;  // without receive time and losses
  Axis axis;             // name "spd", quantity "counts", unit "ps"
};
// Returns nothing for: a wrong size, not 1 to 64 zones, no exposure, a start beyond 1e12 ps, or
// bins not .001 to 1e9 ps wide.
std::optional<HistogramPayload> read_histogram(ByteView payload);

struct ProfilePayload {
  RadarFrame frame;  // includes `power`; without receive time and lost_before
  Axis axis;         // name "radar", quantity "power", unit "m"
};
// Returns nothing for: a wrong size, fewer than 4 bins, a power below 0 or not finite, a range
// beyond 10 km, or a step below 1 um.
std::optional<ProfilePayload> read_profile(ByteView payload);

}  // namespace echofuse::bridge

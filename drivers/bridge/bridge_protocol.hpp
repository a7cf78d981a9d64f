// SPDX-License-Identifier: MIT
// Protocol between our drivers and a sender. The sender is either a small TCP server that uses a
// vendor's library, or a USB device. It sends a stream of blocks; the driver sends nothing. Values
// are little-endian.
//
//   off type   field
//     0 u8[4]  "EFBR"
//     4 u16    version = 1
//     6 u16    kind: 0 hello, 1 tags, 2 depth, 3 bye, 4 histogram, 5 range profile
//     8 u32    sequence: 0 for a connection's first block, +1 for each block, wraps
//    12 u32    payload size in bytes, at most 16 MiB (64 KiB for a hello)
//    16 u64    number of items (tags or frames) that the sender dropped between the previous block
//              and this one, at most 2^40
//    24 u32    reserved = 0
//    28 u32    CRC-32C (RFC 3720) over header bytes 0..27 followed by the payload
//    32        payload
//
//   hello  UTF-8 JSON {"model": "...", "serial": "...", "firmware": "..."}; other keys are ignored.
//          It is the first block. It is repeated about every second as a heartbeat, so that the
//          sender is never silent for more than 1 s. Blocks before a hello are ignored. A detector
//          that sends histograms adds "sends": "histograms". A detector with several zones adds
//          "zones", an array of {"x", "y", "width", "zero_ps"} in the order of the counts. x and y
//          are tangents of the zone's centre, width is the tangent of its full width, and zero_ps
//          is the time that corresponds to range 0.
//   tags   n * 16 bytes as in drivers/core/sample.hpp; n may be 0
//   depth  u32 width, u32 height, u64 device time in us, u32 frame index,
//          f32 x_start, x_step, y_start, y_step (tangents, drivers/core/axis.hpp),
//          then width * height (at most 8192 each) u16 z in mm, row-major, top row first;
//          0 means no measurement
//   histogram  u32 zones (1 to 64), u32 bins, u64 device time in us at the end of the exposure,
//          u64 laser pulses (0: unknown), f64 start of the first bin and f64 bin width in ps,
//          u32 exposure in us (above 0), then zones * bins u32 counts, one zone after the other
//   range profile  u32 bins, u32 frame number, u64 device time in us, f32 range of the first bin
//          in m, f32 step in m, then one f32 of linear power (any scale) per bin
//   bye    no payload; the sender then closes the connection
#pragma once
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/core/frame_buffer.hpp"
#include "drivers/core/result.hpp"
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
  std::uint64_t dropped_items = 0;  // number of items dropped by the sender before this block
  std::uint64_t lost_blocks = 0;    // number of sequence numbers missing before this block
  ByteView payload;                 // valid only until the callback returns
};

// Invariant: bytes == bytes of valid blocks + junk_bytes. `bytes` excludes an incomplete block in
// the buffer, and bytes received after a fault.
struct BlockCounts {
  std::uint64_t bytes = 0, blocks = 0;
  std::uint64_t junk_bytes = 0;   // bytes that do not belong to a valid block
  std::uint64_t bad_headers = 0;  // headers with a wrong magic number, version or other field
  std::uint64_t bad_crcs = 0;
  std::uint64_t gaps = 0;
  std::uint64_t lost_blocks = 0;
};

std::vector<Counter> counters_of(const BlockCounts& counts);

// Parses bytes into blocks and stops at the first invalid block. Because the transport does not
// lose or reorder bytes, a damaged block indicates a faulty sender, and the start of the next block
// is unknown. In a recording, a damaged block is skipped instead.
class BlockParser {
 public:
  using OnBlock = std::function<void(const Block&)>;

  void feed(ByteView bytes, const OnBlock& on_block);
  // Returns a description of the fault that stopped the parser, or null. Bytes after a fault are
  // ignored.
  const char* broken() const { return broken_; }
  // Prepares for a new connection: counts an incomplete block as junk and expects sequence number
  // 0. Must not be called from within on_block.
  void reset(bool recorded = false);
  // Frees the buffer's memory unless it contains an incomplete block. If this function is not
  // called, the memory is kept for later blocks.
  void give_back() { buffer_.give_back(); }
  std::size_t kept_bytes() const { return buffer_.kept_bytes(); }
  const BlockCounts& counts() const { return counts_; }

 private:
  Step next(ByteView bytes, const OnBlock& on_block);
  Step refuse(const char* why, ByteView bytes, std::size_t wrong);
  void discard(std::size_t bytes);
  std::uint64_t missing_before(std::uint32_t sequence);

  // twice the size of the largest block, because a vector's capacity grows by doubling
  FrameBuffer buffer_{2 * (header_bytes + max_payload_bytes)};
  const char* broken_ = nullptr;
  bool recorded_ = false;
  BlockCounts counts_;
  std::uint32_t expected_ = 0;
  std::size_t searched_ = 0;  // bytes of an incomplete block that contain no other block
};

struct Hello {
  std::string model, serial, firmware;
  std::string sends;  // "histograms" if the device sends histograms; empty if it sends tags
  Zones zones;        // zones of the detector; empty if the hello lists no zones
};

// The readers return a failure with the reason if a payload is invalid.

// The payload must be a JSON object of at most 64 KiB. Known keys must have values of the right
// type, and each of at most 64 zones must be plausible.
Result<Hello> read_hello(ByteView payload);

// Returns a view of the tags in the payload if it is suitably aligned, otherwise a view of a copy
// in `scratch`. The last tag must be complete.
Result<std::span<const Tag>> read_tags(ByteView payload, std::vector<Tag>& scratch);

struct DepthPayload {
  DepthFrame frame;  // the fields `received` and `lost_before` are not set
  Axis x, y;
};
// The payload must have the stated size, a width and height of 1 to 8192 pixels, tangents of at
// most 100, and finite steps of at least 1e-6.
Result<DepthPayload> read_depth(ByteView payload);

struct HistogramPayload {
  HistogramFrame frame;  // the fields `received` and `lost_before` are not set
  Axis axis;             // axis with name "spd", quantity "counts" and unit "ps"
};
// The payload must have the stated size, 1 to 64 zones, an exposure above 0, an axis that starts at
// most 1e12 ps from 0, and a bin width of 0.001 ps to 1e9 ps.
Result<HistogramPayload> read_histogram(ByteView payload);

struct ProfilePayload {
  RadarFrame frame;  // `received` and `lost_before` are not set
  Axis axis;         // axis with name "radar", quantity "power" and unit "m"
};
// The payload must have the stated size, at least 4 bins, finite powers of at least 0, ranges of at
// most 10 km, and a step of at least 1 um.
Result<ProfilePayload> read_profile(ByteView payload);

}  // namespace echofuse::bridge

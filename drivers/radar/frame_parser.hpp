// SPDX-License-Identifier: MIT
// TI mmWave out-of-box demo, xWR68xx, SDK 3.x: the data port. Source: mmw_output.h and
// MmwDemo_transmitProcessedOutput of the SDK. Little-endian, 8N1, no checksum.
//
//   off type    field              (the header is 40 bytes)
//     0 u16[4]  magic              02 01 04 03 06 05 08 07 on the wire
//     8 u32     version            major << 24 | minor << 16 | bugfix << 8 | build
//    12 u32     total packet len   header + TLVs + padding; the demo rounds up to 32
//    16 u32     platform           0xa6843, but labs send others
//    20 u32     frame number       since power-up
//    24 u32     time, cpu cycles   200 MHz, wraps every 21.47 s
//    28 u32     detected objects
//    32 u32     number of TLVs
//    36 u32     subframe           from 0; those of a frame have the same frame number
//    40 TLV...  { u32 type, u32 length of the payload, payload }, not aligned
//       padding 0..31 bytes of uninitialised memory
//
//   TLV 2 range profile  u16[bins]        TLV 6 stats  u32[6]
//   TLV 9 temperature    i32, u32, i16[10]
//   TLV 4 heat map of a linear array, TLV 8 of a planar one (AOP, ODS): for each range bin, for
//   each
//         virtual antenna { i16 imaginary, i16 real }, bins from 0, antennas in the order of
//         heat_map_antennas() (antennas.hpp). A sample is the mean over the frame's chirps (Doppler
//         bin 0), behind the coefficients of the cfg's compRangeBiasAndRxChanPhase (SDK 3.4,
//         aoaprocdsp.c, AoAProcDSP_computeHeatMapVal); those of our cfgs are 1. There is no scale
//         but the ADC's. A frame has one of the two.
//   every other type, one of these with another length, or a second one of 2, 4 or 8, is skipped
//   and counted
// Other demos of TI put the same magic before other headers (48 and 52 bytes): those are refused as
// headers or for their TLVs, which do not fill the packet.
//
// Framing: skip by total packet len, then expect the magic. A header of the same version and
// platform inside a frame means that bytes were lost: the outer frame is truncated. The padding may
// hold a stale magic, so there it must be a later frame's. Where no plausible header stands (magic,
// len <= 64 KiB, <= 16 TLVs that fit) the parser searches for the next magic.
//
// Frame numbers: there is no checksum, so a number that jumps is believed once the next one follows
// it. Then a jump ahead is a loss, and a jump back is a board that was reset.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/core/frame_buffer.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::radar {

// bytes == frame_bytes + junk_bytes + truncated_bytes + bytes that still wait for more.
struct FrameCounts {
  std::uint64_t bytes = 0;
  std::uint64_t frames = 0;          // whole and delivered
  std::uint64_t frame_bytes = 0;     // bytes of whole packets, delivered or refused for their TLVs
  std::uint64_t range_profiles = 0;  // frames with TLV 2
  std::uint64_t arrays = 0;          // frames with TLV 4 or 8
  std::uint64_t junk_bytes = 0;      // between frames
  std::uint64_t truncated_frames = 0;  // shorter than their header says; never delivered
  std::uint64_t truncated_bytes = 0;
  std::uint64_t bad_headers = 0;  // a magic with an implausible header
  std::uint64_t bad_tlvs = 0;     // a packet that its TLVs leave, or do not fill
  std::uint64_t other_tlvs = 0;
  std::uint64_t resyncs = 0;      // times the magic was found again after junk
  std::uint64_t lost_frames = 0;  // gaps in the frame numbers
  std::uint64_t restarts = 0;     // times the frame numbers began again
  std::optional<std::uint32_t> first_frame_number, last_frame_number;
  // Well-formed TLVs by type; only the first 64 types that turn up are told apart.
  std::map<std::uint32_t, std::uint64_t> tlvs;
};

// Names what a stream without any frame is instead, by its beginning.
std::string why_no_frames(ByteView beginning);

// All of its numbers but the frame numbers and the TLVs by type.
std::vector<Counter> counters_of(const FrameCounts& counts);

class FrameParser {
 public:
  using OnFrame = std::function<void(RadarFrame)>;

  // Any piece of the stream, split anywhere; `received` is the time at which it was read.
  void feed(ByteView bytes, HostTime received, const OnFrame& on_frame);
  // A frame is whole by its length, but what stands near its end may be the beginning of a later
  // one: only further bytes tell, or their absence.
  bool in_doubt() const { return complete_.has_value(); }
  // No further bytes came for a while: the frame in doubt is delivered.
  void settle(const OnFrame& on_frame);
  // End of input: what waits is a frame whose end was in doubt, a truncated one, or junk. The next
  // feed() starts afresh; counters and frame numbers go on.
  void finish(const OnFrame& on_frame);
  const FrameCounts& counts() const { return counts_; }

 private:
  struct Header;
  static std::optional<Header> read_header(ByteView bytes);
  Step next(ByteView bytes, HostTime received, const OnFrame& on_frame);
  Step skip_junk(ByteView bytes);
  Step skip_truncated(std::size_t bytes);
  std::size_t find_successor(ByteView bytes, const Header& header);
  void deliver(ByteView packet, const Header& header, HostTime received, const OnFrame& on_frame);
  bool read_tlvs(ByteView body, std::uint32_t count, RadarFrame& frame);
  void count_tlv(std::uint32_t type);
  std::uint32_t lost_before(std::uint32_t number);
  void forget_progress();

  FrameBuffer buffer_;
  FrameCounts counts_;
  bool in_junk_ = false;
  std::optional<std::uint32_t> number_before_;  // the one before counts_.last_frame_number
  // The last number did not follow the one before: it is so many further, or less by any amount.
  std::optional<std::uint32_t> jump_;
  std::uint32_t owed_ = 0;  // lost, of a jump at the end of a connection: for the next frame
  // Search state of the frame at the front: bytes searched for its successor, and the time it was
  // complete.
  std::size_t searched_ = 0;
  std::optional<HostTime> complete_;
};

}  // namespace echofuse::radar

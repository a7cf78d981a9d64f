// SPDX-License-Identifier: MIT
// Data port of TI's mmWave out-of-box demo, xWR68xx, SDK 3.x. Source: mmw_output.h and
// MmwDemo_transmitProcessedOutput of the SDK. Little-endian, 8N1, no checksum.
//
//   off type    field              (the header is 40 bytes)
//     0 u16[4]  magic              02 01 04 03 06 05 08 07 on the wire
//     8 u32     version            major << 24 | minor << 16 | bugfix << 8 | build
//    12 u32     total packet len   header + TLVs + padding; the demo rounds up to 32
//    16 u32     platform           0xa6843, lab demos differ
//    20 u32     frame number       since power-up
//    24 u32     time, cpu cycles   200 MHz, wraps every 21.47 s
//    28 u32     detected objects
//    32 u32     number of TLVs
//    36 u32     subframe           from 0; subframes of a frame share its frame number
//    40 TLV...  { u32 type, u32 length of the payload, payload }, not aligned
//       padding 0..31 bytes of uninitialised memory
//
//   TLV 2 range profile  u16[bins]        TLV 6 stats  u32[6]
//   TLV 9 temperature    i32, u32, i16[10]
//   TLV 4 heat map of a linear array, TLV 8 of a planar one (AOP, ODS): for each range bin and
//         virtual antenna { i16 imaginary, i16 real }, bins from 0, antennas in the order of
//         heat_map_antennas() (board_antennas.hpp). A sample is the mean over the frame's chirps
//         (Doppler bin 0), times the coefficients of compRangeBiasAndRxChanPhase (SDK 3.4,
//         aoaprocdsp.c, AoAProcDSP_computeHeatMapVal), which are 1 in our cfgs. Amplitudes are in
//         ADC units. A frame contains TLV 4 or 8, not both.
// Other types, other lengths of these types, and a repeated 2, 4 or 8 are skipped and counted.
// Other TI demos use the same magic with longer headers (48 and 52 bytes). These are rejected
// because of the header, or because their TLVs do not fill the packet.
//
// Framing: skip by total packet len, then expect the magic. A header with the same version and
// platform inside a frame means that bytes were lost: the outer frame is truncated. Padding may
// contain a stale magic; a header there is accepted only with a later frame number. Without a
// plausible header (magic, len <= 64 KiB, <= 16 TLVs that fit) the parser searches for the next
// magic.
//
// Frame numbers have no checksum, so a jump is accepted only if the next number confirms it. A jump
// forward then counts as lost frames, and a jump back as a reset of the board.
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/core/frame_buffer.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::radar {

// Invariant: bytes == frame_bytes + junk_bytes + truncated_bytes + buffered bytes.
struct FrameCounts {
  std::uint64_t bytes = 0;
  std::uint64_t frames = 0;  // complete frames that were delivered
  // bytes of complete packets, including packets that were rejected because of their TLVs
  std::uint64_t frame_bytes = 0;
  std::uint64_t range_profiles = 0;  // frames with a range profile (TLV 2)
  std::uint64_t arrays = 0;          // frames with a heat map (TLV 4 or 8)
  std::uint64_t junk_bytes = 0;      // bytes found between frames
  // frames shorter than announced by their header; not delivered
  std::uint64_t truncated_frames = 0;
  std::uint64_t truncated_bytes = 0;
  std::uint64_t bad_headers = 0;  // magic words followed by an implausible header
  std::uint64_t bad_tlvs = 0;     // packets in which the TLVs leave a gap or do not fit
  // delivered frames that announce one TLV more than they contain
  std::uint64_t excess_tlvs = 0;
  std::uint64_t other_tlvs = 0;
  std::uint64_t resyncs = 0;  // number of times that a frame was found after junk bytes
  std::uint64_t lost_frames = 0;
  std::uint64_t restarts = 0;
  std::optional<std::uint32_t> last_frame_number;
};

// Returns an explanation of why the beginning of a stream contains no frame.
std::string cause_of_no_frames(ByteView beginning);
// Returns how a program or a serial port has changed the bytes of a recording: converted line ends,
// 7 data bits or UTF-8. Otherwise, returns an empty string.
std::string changed_bytes(ByteView bytes);

// Returns all counters except the frame number.
std::vector<Counter> counters_of(const FrameCounts& counts);

class FrameParser {
 public:
  using OnFrame = std::function<void(RadarFrame)>;

  // `antennas`: number of virtual antennas in the range profile, at least 1.
  explicit FrameParser(std::uint32_t antennas) : antennas_(antennas) {}

  // Parses the next bytes of the stream, in pieces of any size. `received`: time at which they were
  // read.
  void feed(ByteView bytes, HostTime received, const OnFrame& on_frame);
  // Returns true if a frame has reached its full length, but its last bytes may be the start of a
  // later frame. More bytes or a call of resolve() resolve the doubt.
  bool in_doubt() const { return complete_.has_value(); }
  // Delivers the frame in doubt. Call this function if no bytes have arrived for some time.
  void resolve(const OnFrame& on_frame);
  // Ends the input: delivers a frame in doubt, and counts the other buffered bytes as truncated or
  // junk. feed() may be called again; counters and frame numbers continue.
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
  bool read_tlv(std::uint32_t type, ByteView payload, RadarFrame& frame) const;
  bool read_tlvs(ByteView body, std::uint32_t count, RadarFrame& frame);
  std::uint32_t lost_before(std::uint32_t number);
  void forget_progress();

  std::uint32_t antennas_;
  FrameBuffer buffer_;
  FrameCounts counts_;
  bool in_junk_ = false;
  // frame number that preceded counts_.last_frame_number
  std::optional<std::uint32_t> number_before_;
  // Number of frames missing between the last two frame numbers, if the next number must still
  // confirm the gap. It is modulo 2^32, so a backward step gives a large value.
  std::optional<std::uint32_t> jump_;
  // number of frames lost at the end of a connection; reported with the next frame
  std::uint32_t owed_ = 0;
  // State of the search in the first buffered frame: number of bytes already scanned for a later
  // frame header, and the time at which the frame was complete.
  std::size_t searched_ = 0;
  std::optional<HostTime> complete_;
};

}  // namespace echofuse::radar

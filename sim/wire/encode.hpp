// SPDX-License-Identifier: MIT
// Encodes the data of the simulated devices. The encoders are written from the format descriptions,
// independently of the parsers in drivers/, so that the tests detect mistakes in a parser.
#pragma once
#include <complex>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "drivers/core/random.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::sim {

// Header of a block in version 1 of the bridge protocol (little-endian; offsets in bytes):
//   0 u8[4] "EFBR" | 4 u16 version | 6 u16 kind | 8 u32 sequence | 12 u32 payload bytes
//   16 u64 items dropped before this block | 24 u32 0 | 28 u32 CRC-32C of bytes 0..27 and payload
enum class BlockKind : std::uint16_t { hello = 0, tags = 1, depth = 2, bye = 3, histogram = 4 };
inline constexpr std::size_t bridge_header_bytes = 32;
Bytes bridge_block(BlockKind kind, std::uint32_t sequence, std::uint64_t dropped, ByteView payload);

// Payload of a histogram block (offsets in bytes):
//   0 u32 zones | 4 u32 bins | 8 u64 device time, us | 16 u64 pulses | 24 f64 first bin, ps
//   32 f64 bin width, ps | 40 u32 exposure, us | 44 u32 counts, zone after zone
Bytes histogram_payload(std::span<const std::uint32_t> counts, std::uint32_t bins,
                        std::uint64_t time_us, std::uint64_t pulses, double first_bin_ps,
                        double bin_width_ps, std::uint32_t exposure_us);

// A detection is encoded as a 16-byte tag: u8 type 0 | u8 0 | u16 0 | i32 channel | i64 time_ps
inline constexpr std::size_t tag_bytes = 16;
void put_tag(Bytes& out, std::int32_t channel, std::int64_t time_ps);

// A frame of TI's out-of-box demo (SDK 3.x, mmw_output.h) consists of a 40-byte header, TLVs {u32
// type, u32 payload length, payload}, and padding to a multiple of 32 bytes. The firmware pads with
// old memory contents. Here the padding is random data from `junk`, sometimes including a magic
// word.
struct RadarHeader {
  std::uint32_t frame_number = 0;
  std::uint32_t time_cpu_cycles = 0;
  std::uint32_t detected_objects = 0;
  std::uint32_t subframe = 0;
};
struct RadarTlv {
  std::uint32_t type = 0;
  Bytes payload;
};
// SDK version 3.5.0.4, and the platform number of the xWR68xx demo.
inline constexpr std::uint32_t radar_sdk_version = 0x03050004, radar_platform = 0xA6843;
Bytes radar_frame(const RadarHeader& header, const std::vector<RadarTlv>& tlvs, Rng& junk);

RadarTlv objects_tlv();  // Returns a TLV of type 1 with an empty list of objects.
RadarTlv range_profile_tlv(const std::vector<std::uint16_t>& codes);  // Returns a TLV of type 2.
// Returns the heat map as a TLV of type 4 or, if `planar` is true, of type 8. It contains the i16
// imaginary and i16 real part of each sample: [range bin][antenna].
RadarTlv heat_map_tlv(bool planar, std::span<const std::complex<float>> samples);
RadarTlv stats_tlv(const RadarStats& stats);                    // Returns a TLV of type 6.
RadarTlv temperature_tlv(const RadarTemperature& temperature);  // Returns a TLV of type 9.

// Returns the code of a bin in the range profile: the sum of log2(magnitude) over the virtual
// antennas, divided by their number rounded up to a power of two, in Q8 format
// (DPIF_DETMATRIX_DATA_QFORMAT of TI's objectdetection).
std::uint16_t log2_q8(double sum_log2_magnitude, unsigned antennas);

}  // namespace echofuse::sim

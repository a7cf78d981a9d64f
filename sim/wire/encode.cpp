// SPDX-License-Identifier: MIT
#include "sim/wire/encode.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "drivers/core/crc32c.hpp"

namespace echofuse::sim {
namespace {

// Magic word of radar frames: the u16 numbers 0x0102, 0x0304, 0x0506 and 0x0708 (SDK 3.x,
// mmw_output.h).
constexpr std::uint64_t magic = 0x0708050603040102;
// The length of a radar frame in bytes is a multiple of this number.
constexpr std::size_t radar_unit = 32;

void append(Bytes& out, ByteView bytes) { out.insert(out.end(), bytes.begin(), bytes.end()); }

void put_padding(Bytes& out, std::size_t size, Rng& junk) {
  const std::size_t start = out.size();
  while (out.size() < size) out.push_back(static_cast<std::uint8_t>(junk()));
  const std::size_t room = size - start;
  if (room < sizeof magic || junk() % 4 != 0) return;
  const std::size_t offset = junk() % (room - sizeof magic + 1);
  std::memcpy(out.data() + start + offset, &magic, sizeof magic);
}

}  // namespace

Bytes bridge_block(BlockKind kind, std::uint32_t sequence, std::uint64_t dropped,
                   ByteView payload) {
  Bytes out;
  out.reserve(bridge_header_bytes + payload.size());
  for (const char c : {'E', 'F', 'B', 'R'}) put(out, c);
  put<std::uint16_t>(out, 1);
  put(out, static_cast<std::uint16_t>(kind));
  put(out, sequence);
  put(out, static_cast<std::uint32_t>(payload.size()));
  put(out, dropped);
  put<std::uint32_t>(out, 0);
  put(out, crc32c(payload, crc32c(out)));
  append(out, payload);
  return out;
}

void put_tag(Bytes& out, std::int32_t channel, std::int64_t time_ps) {
  put<std::uint32_t>(out, 0);
  put(out, channel);
  put(out, time_ps);
}

Bytes histogram_payload(std::span<const std::uint32_t> counts, std::uint32_t bins,
                        std::uint64_t time_us, std::uint64_t pulses, double first_bin_ps,
                        double bin_width_ps, std::uint32_t exposure_us) {
  Bytes out;
  put(out, static_cast<std::uint32_t>(counts.size() / bins));
  put(out, bins);
  put(out, time_us);
  put(out, pulses);
  put(out, first_bin_ps);
  put(out, bin_width_ps);
  put(out, exposure_us);
  for (const std::uint32_t n : counts) put(out, n);
  return out;
}

Bytes radar_frame(const RadarHeader& header, const std::vector<RadarTlv>& tlvs, Rng& junk) {
  std::size_t size = 40;
  for (const auto& tlv : tlvs) size += 8 + tlv.payload.size();
  size = (size + radar_unit - 1) / radar_unit * radar_unit;
  Bytes out;
  out.reserve(size);
  put(out, magic);
  put(out, radar_sdk_version);
  put(out, static_cast<std::uint32_t>(size));
  put(out, radar_platform);
  put(out, header.frame_number);
  put(out, header.time_cpu_cycles);
  put(out, header.detected_objects);
  put(out, static_cast<std::uint32_t>(tlvs.size()));
  put(out, header.subframe);
  for (const auto& tlv : tlvs) {
    put(out, tlv.type);
    put(out, static_cast<std::uint32_t>(tlv.payload.size()));
    append(out, tlv.payload);
  }
  put_padding(out, size, junk);
  return out;
}

RadarTlv objects_tlv() { return {1, {}}; }

RadarTlv range_profile_tlv(const std::vector<std::uint16_t>& codes) {
  RadarTlv tlv{2, {}};
  for (const auto code : codes) put(tlv.payload, code);
  return tlv;
}

RadarTlv heat_map_tlv(bool planar, std::span<const std::complex<float>> samples) {
  RadarTlv tlv{planar ? 8u : 4u, {}};
  for (const auto sample : samples)
    for (const float part : {sample.imag(), sample.real()})
      put(tlv.payload,
          static_cast<std::int16_t>(std::clamp(std::round(part), -32768.0f, 32767.0f)));
  return tlv;
}

RadarTlv stats_tlv(const RadarStats& s) {
  RadarTlv tlv{6, {}};
  for (const std::uint32_t v :
       {s.inter_frame_processing_us, s.transmit_us, s.inter_frame_margin_us,
        s.inter_chirp_margin_us, s.active_frame_load_percent, s.inter_frame_load_percent})
    put(tlv.payload, v);
  return tlv;
}

RadarTlv temperature_tlv(const RadarTemperature& t) {
  RadarTlv tlv{9, {}};
  put(tlv.payload, t.invalid);
  put(tlv.payload, t.time_ms);
  for (const std::int16_t c : t.celsius) put(tlv.payload, c);
  return tlv;
}

std::uint16_t log2_q8(double sum_log2_magnitude, unsigned antennas) {
  const double code = 256 * sum_log2_magnitude / std::bit_ceil(antennas);
  return static_cast<std::uint16_t>(std::clamp(std::round(code), 0.0, 65535.0));
}

}  // namespace echofuse::sim

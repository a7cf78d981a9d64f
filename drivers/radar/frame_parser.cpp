// SPDX-License-Identifier: MIT
#include "drivers/radar/frame_parser.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "drivers/radar/log2_codes.hpp"
#include "drivers/util/line_ends.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::radar {
namespace {

// Layout of a frame in TI's demo (SDK 3.x, demo/xwr68xx/mmw/include/mmw_output.h). The length of a
// frame is rounded up to a multiple of 32 bytes.
constexpr std::array<std::uint8_t, 8> magic = {2, 1, 4, 3, 6, 5, 8, 7};
constexpr std::size_t header_bytes = 40;
constexpr std::size_t tlv_header_bytes = 8;
constexpr std::uint32_t max_packet_bytes = 64u << 10;
constexpr std::uint32_t max_tlvs = 16;
constexpr std::size_t padding_limit = 32;
// A larger jump in the frame number indicates corruption or a restart, not lost frames.
constexpr std::uint32_t max_lost_frames = 1u << 20;
// a larger gap is counted only if the next frame number confirms it
constexpr std::uint32_t usual_gap = 100;

std::uint32_t between(std::uint32_t earlier, std::uint32_t later) { return later - earlier - 1; }

bool starts_with_magic(ByteView bytes) {
  return bytes.size() >= magic.size() && std::equal(magic.begin(), magic.end(), bytes.begin());
}

bool starts_with_part_of_magic(ByteView bytes) {
  const std::size_t n = std::min(bytes.size(), magic.size());
  return std::equal(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n), magic.begin());
}

// Returns the position of the first magic word at or after `from`, or of a partial magic word at
// the end. If neither exists, returns the number of bytes.
std::size_t find_magic(ByteView bytes, std::size_t from) {
  while (from < bytes.size()) {
    const void* first = std::memchr(bytes.data() + from, magic[0], bytes.size() - from);
    if (!first) break;
    from = static_cast<std::size_t>(static_cast<const std::uint8_t*>(first) - bytes.data());
    if (starts_with_part_of_magic(bytes.subspan(from))) return from;
    ++from;
  }
  return bytes.size();
}

// Returns true if the TLVs fill the packet, assuming that the header has this length and that each
// TLV length includes `extra` additional bytes.
bool fill(ByteView packet, std::size_t header, std::size_t extra) {
  std::size_t at = header;
  while (packet.size() >= at + padding_limit) {
    ByteReader in(packet.subspan(at));
    const auto type = in.get<std::uint32_t>(), length = in.get<std::uint32_t>();
    if (type == 0 || length < extra || length > packet.size()) return false;
    at += tlv_header_bytes + length - extra;
  }
  return at > header && at <= packet.size();
}

}  // namespace

std::string changed_bytes(ByteView bytes) {
  // Number of line feeds and of shortened frames required to detect converted line endings. Lost
  // bytes shorten a few frames. The platform field of every frame contains a line feed.
  constexpr std::ptrdiff_t enough = 4;
  constexpr std::size_t few_bytes = 1000, incomplete = 3;  // the last character may be incomplete
  if (has_added_returns(bytes)) return added_returns;
  const std::string all(bytes.begin(), bytes.end());
  if (all.size() > few_bytes && std::ranges::none_of(bytes, [](int b) { return b > 127; }))
    return "no byte exceeds 127: was the serial port opened with 7 data bits?";
  if (all.size() > few_bytes && utf8_text(all).starts_with(all.substr(0, all.size() - incomplete)))
    return "the bytes were converted to UTF-8 because the file was saved as text";
  if (std::ranges::count(all, '\n') < enough || all.find("\r\n") != all.npos) return {};
  std::ptrdiff_t shortened = 0, unexplained = 0;
  for (std::size_t begin = find_magic(bytes, 0), end; begin < bytes.size(); begin = end) {
    end = find_magic(bytes, begin + 1);
    const ByteView packet = bytes.subspan(begin, end - begin);
    if (end + header_bytes > bytes.size() || packet.size() < header_bytes) continue;
    constexpr std::size_t size_at = 12;  // offset of the packet's size in its header
    const std::size_t stated = ByteReader(packet.subspan(size_at)).get<std::uint32_t>();
    const auto feeds_inside = std::ranges::count(packet.subspan(header_bytes), '\n');
    if (stated <= packet.size()) continue;
    const bool explained = stated - packet.size() <= static_cast<std::size_t>(feeds_inside);
    ++(explained ? shortened : unexplained);
  }
  if (shortened < enough || 4 * unexplained > shortened) return {};
  return "line ends were converted because the file was saved as text: CR LF became LF, and frames "
         "are shorter than they state";
}

std::string cause_of_no_frames(ByteView bytes) {
  if (bytes.empty()) return "the file is empty";
  const std::size_t first = find_magic(bytes, 0);
  const std::size_t end = find_magic(bytes, std::min(first + 1, bytes.size()));
  if (first == bytes.size()) {
    const std::string text(bytes.begin(), bytes.end());
    if (text.find(":/>") != text.npos)
      return "the file contains text of the command port; expected the data port's bytes";
    const bool plain = std::ranges::all_of(text, [](char c) { return c >= '\t' && c <= '~'; });
    return plain ? "the file contains text; expected the data port's bytes"
                 : "no frame header found: was the file recorded at the data port's baud rate?";
  }
  if (const std::string changed = changed_bytes(bytes); !changed.empty()) return changed;
  const ByteView packet = bytes.subspan(first, end - first);
  if (fill(packet, 36, 0)) return "the frames are from SDK 1 or 2.0 (header of 36 bytes)";
  for (const std::size_t header : {36u, 40u})
    if (fill(packet, header, tlv_header_bytes))
      return "the TLV lengths include the TLV headers, as in SDK 1";
  for (const std::size_t header : {44u, 48u, 52u, 56u})
    if (fill(packet, header, 0) || fill(packet, header, tlv_header_bytes))
      return "the frames are not from the out-of-box demo (header of " + std::to_string(header) +
             " bytes)";
  return end == bytes.size() ? "the file contains only part of a frame"
                             : "the frames are not from the out-of-box demo";
}

// Fields of the header, in wire order.
struct FrameParser::Header {
  std::array<std::uint8_t, 8> magic_word;
  std::uint32_t version, packet_bytes, platform, frame_number, cpu_cycles, objects, tlvs, subframe;

  bool plausible() const {
    return magic_word == magic && packet_bytes <= max_packet_bytes && tlvs <= max_tlvs &&
           packet_bytes >= header_bytes + tlvs * tlv_header_bytes;
  }
  bool like(const Header& other) const {
    return version == other.version && platform == other.platform;
  }
  bool precedes(const Header& later) const {
    return like(later) && between(frame_number, later.frame_number) < max_lost_frames;
  }
};

// Returns nullopt if the header is not plausible. `bytes` must contain at least header_bytes.
std::optional<FrameParser::Header> FrameParser::read_header(ByteView bytes) {
  static_assert(sizeof(Header) == header_bytes);
  const auto header = ByteReader(bytes).get<Header>();
  return header.plausible() ? std::optional(header) : std::nullopt;
}

void FrameParser::feed(ByteView bytes, HostTime received, const OnFrame& on_frame) {
  counts_.bytes += bytes.size();
  buffer_.feed(bytes, [&](ByteView view) { return next(view, received, on_frame); });
}

void FrameParser::resolve(const OnFrame& on_frame) {
  if (!complete_) return;
  const HostTime received = *complete_;
  const Bytes held(buffer_.held().begin(), buffer_.held().end());
  // The buffer may be incomplete if on_frame threw an exception.
  if (held.size() < header_bytes) return forget_progress();
  const Header header = *read_header(held);
  buffer_.clear();
  forget_progress();
  const ByteView all = held;
  deliver(all.first(header.packet_bytes), header, received, on_frame);
  buffer_.feed(all.subspan(header.packet_bytes),
               [&](ByteView view) { return next(view, received, on_frame); });
}

void FrameParser::finish(const OnFrame& on_frame) {
  resolve(on_frame);
  const ByteView rest = buffer_.held();
  if (starts_with_magic(rest))
    skip_truncated(rest.size());
  else
    counts_.junk_bytes += rest.size();
  buffer_.clear();
  forget_progress();
  in_junk_ = false;
  if (const auto jump = std::exchange(jump_, {}); jump && *jump <= max_lost_frames) {
    counts_.lost_frames += *jump;
    owed_ += *jump;
  }
}

Step FrameParser::next(ByteView bytes, HostTime received, const OnFrame& on_frame) {
  if (!bytes.empty() && !starts_with_part_of_magic(bytes)) return skip_junk(bytes);
  if (bytes.size() < magic.size()) return {0, magic.size()};
  if (bytes.size() < header_bytes) return {0, header_bytes};
  const auto header = read_header(bytes);
  if (!header) {
    ++counts_.bad_headers;
    return skip_junk(bytes);
  }
  if (std::exchange(in_junk_, false)) ++counts_.resyncs;
  const std::size_t size = header->packet_bytes;
  if (bytes.size() >= size && !complete_) complete_ = received;
  const std::size_t successor = find_successor(bytes, *header);
  if (successor < size && bytes.size() - successor >= header_bytes)
    return skip_truncated(successor);
  if (successor < size || !complete_) return {0, 0};
  deliver(bytes.first(size), *header, *complete_, on_frame);
  forget_progress();
  return {size, 0};
}

Step FrameParser::skip_junk(ByteView bytes) {
  in_junk_ = true;
  const std::size_t junk = find_magic(bytes, 1);
  counts_.junk_bytes += junk;
  return {junk, 0};
}

Step FrameParser::skip_truncated(std::size_t bytes) {
  ++counts_.truncated_frames;
  counts_.truncated_bytes += bytes;
  forget_progress();
  return {bytes, 0};
}

// Returns the position at which a later frame starts inside this packet, or the end of the packet
// if it contains no later frame. The position is uncertain if fewer than `header_bytes` bytes
// follow it.
std::size_t FrameParser::find_successor(ByteView bytes, const Header& header) {
  const std::size_t end = std::min<std::size_t>(bytes.size(), header.packet_bytes);
  searched_ = std::max(searched_, magic.size());
  while ((searched_ = find_magic(bytes.first(end), searched_)) < end) {
    const ByteView candidate = bytes.subspan(searched_);
    const bool open = candidate.size() < header_bytes && starts_with_part_of_magic(candidate);
    const auto later = candidate.size() < header_bytes ? std::nullopt : read_header(candidate);
    const bool in_padding = header.packet_bytes - searched_ < padding_limit;
    if (open || (later && (in_padding ? header.precedes(*later) : header.like(*later)))) break;
    ++searched_;
  }
  return searched_;
}

void FrameParser::deliver(ByteView packet, const Header& header, HostTime received,
                          const OnFrame& on_frame) {
  counts_.frame_bytes += packet.size();
  RadarFrame frame;
  frame.received = received;
  frame.frame_number = header.frame_number;
  frame.time_cpu_cycles = header.cpu_cycles;
  frame.subframe = header.subframe;
  if (!read_tlvs(packet.subspan(header_bytes), header.tlvs, frame)) return;
  frame.lost_before = lost_before(header.frame_number) + std::exchange(owed_, 0);
  ++counts_.frames;
  if (!frame.power.empty()) ++counts_.range_profiles;
  if (!frame.array.empty()) ++counts_.arrays;
  on_frame(std::move(frame));
}

bool FrameParser::read_tlv(std::uint32_t type, ByteView payload, RadarFrame& frame) const {
  if (type == 2 && payload.size() % 2 == 0 && frame.power.empty()) {
    for (const std::uint16_t code : to_values<std::uint16_t>(payload))
      frame.power.push_back(power_from_code(code, antennas_));
    return true;
  }
  constexpr std::size_t sample_bytes = 4;  // i16 imaginary part, i16 real part (SDK 3.x)
  if ((type == 4 || type == 8) && payload.size() % sample_bytes == 0 && frame.array.empty()) {
    frame.array = to_values<std::int16_t>(payload);
    frame.planar = type == 8;
    return true;
  }
  if (type == 6 && payload.size() == sizeof(RadarStats)) {
    frame.stats = ByteReader(payload).get<RadarStats>();
    return true;
  }
  if (type == 9 && payload.size() == sizeof(RadarTemperature)) {
    frame.temperature = ByteReader(payload).get<RadarTemperature>();
    return true;
  }
  return false;
}

// Returns false if the structure is broken: a TLV exceeds the packet, or the TLVs are followed by
// more bytes than padding can explain. A TLV that would start within the padding, and does not fit
// or has type 0, is only counted, because some guiMonitor values make the firmware announce a TLV
// that it does not send.
bool FrameParser::read_tlvs(ByteView body, std::uint32_t count, RadarFrame& frame) {
  ByteReader in(body);
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::size_t left = in.left();
    const auto type = in.get<std::uint32_t>();
    const auto payload = in.take(in.get<std::uint32_t>());
    const bool in_padding = left < padding_limit;
    if (!in.ok() || (in_padding && type == 0)) {
      ++(in_padding ? counts_.excess_tlvs : counts_.bad_tlvs);
      return in_padding;
    }
    if (!read_tlv(type, payload, frame)) ++counts_.other_tlvs;
  }
  if (in.left() < padding_limit) return true;
  ++counts_.bad_tlvs;
  return false;
}

std::uint32_t FrameParser::lost_before(std::uint32_t number) {
  const auto last = std::exchange(counts_.last_frame_number, number);
  if (!last || number == *last) return 0;
  const auto jump = std::exchange(jump_, {});
  const bool follows = between(*last, number) <= usual_gap;
  const std::uint32_t onwards = number_before_ ? number - *number_before_ : 0;
  std::uint32_t lost = 0;
  if ((jump || !follows) && number_before_ && onwards <= usual_gap + 1) {
    // The previous number was corrupt or stale, so the count continues from the number before it.
    lost = jump && onwards > 2 ? onwards - 2 : 0;
    counts_.lost_frames += lost;
    return lost;
  }
  if (!follows) {
    jump_ = between(*last, number);
  } else {
    if (jump && *jump > max_lost_frames) ++counts_.restarts;
    lost = between(*last, number) + (jump && *jump <= max_lost_frames ? *jump : 0);
  }
  number_before_ = last;
  counts_.lost_frames += lost;
  return lost;
}

void FrameParser::forget_progress() {
  searched_ = 0;
  complete_.reset();
}

std::vector<Counter> counters_of(const FrameCounts& c) {
  return {{"bytes", c.bytes},
          {"frames", c.frames},
          {"frame_bytes", c.frame_bytes},
          {"range_profiles", c.range_profiles},
          {"arrays", c.arrays},
          {"other_tlvs", c.other_tlvs},
          {"junk_bytes", c.junk_bytes},
          {"truncated_frames", c.truncated_frames},
          {"truncated_bytes", c.truncated_bytes},
          {"bad_headers", c.bad_headers},
          {"bad_tlvs", c.bad_tlvs},
          {"excess_tlvs", c.excess_tlvs},
          {"resyncs", c.resyncs},
          {"lost_frames", c.lost_frames},
          {"restarts", c.restarts}};
}

}  // namespace echofuse::radar

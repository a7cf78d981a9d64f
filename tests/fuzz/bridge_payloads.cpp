// SPDX-License-Identifier: MIT
// Input: u8 kind, then the payload of a hello, tags, a depth frame, a histogram or a range profile.
#include <cmath>

#include "drivers/bridge/bridge_writer.hpp"
#include "fuzz.hpp"

using namespace echofuse::bridge;

namespace {

void hello(ByteView payload) {
  const auto hello = read_hello(payload);
  Bytes longer(payload.begin(), payload.end());
  longer.push_back('x');
  const bool has_nul = std::ranges::find(payload, 0) != payload.end();  // a NUL ends the string
  require(has_nul || !read_hello(longer), "nothing may follow the object");
  const auto begin = fuzz::text_of(payload).find('{');
  if (!hello) return;
  require(begin != std::string_view::npos, "a hello is an object");
  const std::size_t size = hello->model.size() + hello->serial.size() + hello->firmware.size();
  require(size <= payload.size(), "its texts come from the payload");
  require(hello->zones.size() <= max_zones &&
              std::ranges::all_of(hello->zones, [](const Zone& z) { return z.plausible(); }),
          "zones are plausible");
}

void tags(ByteView payload) {
  Bytes shifted{0};
  shifted.insert(shifted.end(), payload.begin(), payload.end());
  for (const ByteView bytes : {payload, ByteView(shifted).subspan(1)}) {
    std::vector<Tag> scratch;
    const auto read = read_tags(bytes, scratch);
    require(static_cast<bool>(read) == (payload.size() % 16 == 0), "tags are whole or none");
    if (!read) continue;
    require(read->size() == payload.size() / 16, "no tag is missing");
    const auto* first = reinterpret_cast<const std::uint8_t*>(read->data());
    require(std::equal(payload.begin(), payload.end(), first), "they are the payload's bytes");
  }
}

void depth(ByteView payload) {
  const auto read = read_depth(payload);
  if (!read) return;
  const DepthFrame& frame = read->frame;
  require(depth_payload(frame, read->x, read->y) == Bytes(payload.begin(), payload.end()),
          "the frame has the header's values and the payload's pixels");
  for (const Axis& axis : {read->x, read->y})
    require(std::abs(axis.start) <= 100 && std::abs(axis.at(axis.count)) <= 101 &&
                std::abs(axis.step) >= 1e-6 && axis.count <= max_depth_side,
            "the axes are those of a lens");
}

void histogram(ByteView payload) {
  const auto read = read_histogram(payload);
  if (!read) return;
  const HistogramFrame& frame = read->frame;
  Bytes again;
  put(again, frame.zones), put(again, read->axis.count), put(again, frame.device_time_us);
  put(again, frame.pulses), put(again, read->axis.start), put(again, read->axis.step);
  put(again, frame.exposure_us);
  const ByteView counts = as_bytes(frame.counts);
  again.insert(again.end(), counts.begin(), counts.end());
  require(std::ranges::equal(again, payload), "the histogram has the values of the payload");
  require(frame.zones >= 1 && frame.zones <= 64 && read->axis.count >= 1 && frame.exposure_us > 0 &&
              frame.pulses <= max_dropped_items && std::abs(read->axis.start) <= 1e12 &&
              read->axis.step >= 1e-3 && read->axis.step <= 1e9,
          "its size and its axis are valid");
}

void profile(ByteView payload) {
  const auto read = read_profile(payload);
  if (!read) return;
  const RadarFrame& frame = read->frame;
  require(payload.size() == 24 + 4 * std::uint64_t{read->axis.count}, "a profile is complete");
  require(std::ranges::equal(as_bytes(frame.power), payload.subspan(24)),
          "the profile has the payload's power");
  require(std::ranges::all_of(frame.power, [](float p) { return p >= 0 && std::isfinite(p); }),
          "a power is not negative");
  require(std::abs(read->axis.at(read->axis.count)) < 1e5 && read->axis.step > 0,
          "its ranges are finite");
}

}  // namespace

void fuzz::run(ByteView input) {
  if (input.empty()) return;
  const ByteView payload = input.subspan(1);
  constexpr void (*kinds[])(ByteView) = {hello, tags, depth, histogram, profile};
  kinds[input[0] % std::size(kinds)](payload);
}

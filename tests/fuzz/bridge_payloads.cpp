// SPDX-License-Identifier: MIT
// Input: u8 kind, then the payload of a hello, tags, a depth frame, a histogram or a range profile.
#include <cmath>

#include "drivers/bridge/bridge_protocol.hpp"
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
  ByteReader in(payload);
  const auto width = in.get<std::uint32_t>(), height = in.get<std::uint32_t>();
  const auto time = in.get<std::uint64_t>();
  const auto index = in.get<std::uint32_t>();
  float axes[4];
  for (float& value : axes) value = in.get<float>();
  // The check keeps the number of pixels below 2^31, so that the product cannot overflow.
  const bool fits = in.ok() && width && height && in.left() / 2 / width == height &&
                    in.left() == std::uint64_t{width} * height * 2;
  const auto lens = [&](std::size_t at, std::uint32_t count) {
    const double start = axes[at], step = axes[at + 1];
    return std::abs(start) <= 100 && std::abs(start + step * count) <= 100 &&
           std::abs(step) >= 1e-6 && count <= max_depth_side;
  };
  require(static_cast<bool>(read) == (fits && lens(0, width) && lens(2, height)),
          "a frame is accepted exactly if its size and axes are valid");
  if (!read) return;
  const DepthFrame& frame = read->frame;
  require(frame.width == width && frame.height == height && frame.device_time_us == time &&
              frame.frame_number == index && read->x.count == width && read->y.count == height,
          "the frame has the header's values");
  require(std::ranges::equal(as_bytes(frame.depth_mm), in.take(in.left())),
          "the frame has the payload's pixels");
}

void histogram(ByteView payload) {
  const auto read = read_histogram(payload);
  ByteReader in(payload);
  const std::uint64_t zones = in.get<std::uint32_t>(), bins = in.get<std::uint32_t>();
  const auto time = in.get<std::uint64_t>(), pulses = in.get<std::uint64_t>();
  const auto start = in.get<double>(), width = in.get<double>();
  const auto exposure = in.get<std::uint32_t>();
  const bool fits = in.ok() && zones >= 1 && zones <= 64 && bins >= 1 && exposure > 0 &&
                    in.left() == 4 * zones * bins && pulses <= max_dropped_items &&
                    std::abs(start) <= 1e12 && width >= 1e-3 && width <= 1e9;
  require(static_cast<bool>(read) == fits,
          "a histogram is accepted exactly if its size and axis are valid");
  if (!read) return;
  const HistogramFrame& frame = read->frame;
  require(frame.zones == zones && frame.device_time_us == time && frame.pulses == pulses &&
              frame.exposure_us == exposure && read->axis.count == bins &&
              read->axis.start == start && read->axis.step == width,
          "the histogram has the header's values");
  require(std::ranges::equal(as_bytes(frame.counts), in.take(in.left())),
          "the histogram has the payload's counts");
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

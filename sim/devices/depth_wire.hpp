// SPDX-License-Identifier: MIT
// Protocol of the unix socket between a laboratory and the OpenNI2 driver module. The first header
// has pixel_bytes 0 and describes the camera. Each further header is followed by a frame of width *
// height depths z (u16, mm), row-major from the top left. Both ends come from the same build and
// run on the same machine, so the byte order and the padding are native.
#pragma once
#include <cstdint>

namespace echofuse::sim {

inline constexpr std::uint32_t depth_magic = 0x44464531;  // "1EFD" in little-endian byte order

struct DepthHeader {
  std::uint32_t magic = depth_magic;
  std::uint32_t width = 0, height = 0;
  std::uint32_t fps = 0;
  float horizontal_fov_rad = 0, vertical_fov_rad = 0;
  std::uint32_t frame_index = 0;
  std::uint32_t pixel_bytes = 0;
  std::uint64_t time_us = 0;    // time on the camera clock, us
  std::uint32_t truncated = 0;  // if nonzero, the module delivers only the first half of the frame
  std::uint32_t reserved = 0;
};
static_assert(sizeof(DepthHeader) == 48);

}  // namespace echofuse::sim

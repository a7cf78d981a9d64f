// SPDX-License-Identifier: MIT
// Protocol of the laboratory's unix socket to the OpenNI2 driver module: first a header with
// pixel_bytes 0 (the camera's fixed properties), then headers followed by width * height u16 of z
// in millimetres, row-major from the top left. Both ends come from one build on one machine.
#pragma once
#include <cstdint>

namespace echofuse::sim {

inline constexpr std::uint32_t depth_magic = 0x44464531;  // "1EFD"

struct DepthHeader {
  std::uint32_t magic = depth_magic;
  std::uint32_t width = 0, height = 0;
  std::uint32_t fps = 0;
  float horizontal_fov_rad = 0, vertical_fov_rad = 0;
  std::uint32_t frame_index = 0;
  std::uint32_t pixel_bytes = 0;
  std::uint64_t time_us = 0;    // the camera's clock
  std::uint32_t truncated = 0;  // nonzero: the module delivers only half of the frame
  std::uint32_t reserved = 0;
};
static_assert(sizeof(DepthHeader) == 48);

}  // namespace echofuse::sim

// SPDX-License-Identifier: MIT
#include "sim/devices/tag_stream.hpp"

#include <algorithm>
#include <cmath>

namespace echofuse::sim {
namespace {

// Maximum time span of the tags emitted by one call of advance(), s. Tags that are late by more
// than `device_memory_s` are lost, as in a real device with a full memory.
constexpr double longest_tick_s = 0.1, device_memory_s = 1;

}  // namespace

TagStream::TagStream(ScenePlayer& player, const TdcOptions& options)
    : player_(player),
      longest_block_s_(std::chrono::duration<double>(options.longest).count()),
      source_(player.conditions(), options.tagging, options.window_s, options.seed) {}

void TagStream::start() { next_pulse_ = pulse_at(player_.now_s()); }

void TagStream::advance(const Emit& emit, const Lose& lose) {
  std::int64_t now = pulse_at(player_.now_s());
  const auto lag_s = static_cast<double>(now - next_pulse_) / source_.laser_rate_hz();
  if (lag_s > device_memory_s) {
    lose(static_cast<std::uint64_t>(source_.mean_tags(now - next_pulse_)));
    next_pulse_ = now;
  }
  now = std::min(now, pulse_at(time_of(next_pulse_) + longest_tick_s));
  do {
    const double from_s = time_of(next_pulse_) + 0.5 / source_.laser_rate_hz();
    select_scene(from_s);
    const double until_s = std::min(from_s + longest_block_s_, player_.scene_end_s(from_s));
    const std::int64_t last = std::min(now, std::max(next_pulse_ + 1, pulse_at(until_s)));
    if (last <= next_pulse_) break;
    Bytes payload;
    const std::size_t tags = source_.draw(next_pulse_, last, payload);
    next_pulse_ = last;
    emit(payload, tags);
  } while (next_pulse_ < now);
}

std::int64_t TagStream::pulse_at(double time_s) const {
  return static_cast<std::int64_t>(std::floor(time_s * source_.laser_rate_hz()));
}

double TagStream::time_of(std::int64_t pulse) const {
  return static_cast<double>(pulse) / source_.laser_rate_hz();
}

void TagStream::select_scene(double time_s) {
  const RenderedScene& rendered = player_.at(time_s);
  if (rendered.index == scene_index_) return;
  source_.set_returns(rendered.spd);
  scene_index_ = rendered.index;
}

}  // namespace echofuse::sim

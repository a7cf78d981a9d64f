// SPDX-License-Identifier: MIT
#include "sim/devices/fault_injector.hpp"

#include <algorithm>
#include <cmath>

namespace echofuse::sim {
namespace {

constexpr auto poll_pause = std::chrono::milliseconds(5);

}  // namespace

FaultInjector::FaultInjector(port::Loop& loop, ScenePlayer& player, const char* device,
                             const FaultPlan& plan, std::uint64_t seed,
                             std::function<void()> on_poll)
    : player_(player),
      device_(device),
      faults_(plan.faults, device),
      sent_log_(plan.sent_log),
      rng_(make_rng(seed, 100 + static_cast<std::uint64_t>(device[0]))),
      timer_(loop),
      on_poll_(std::move(on_poll)) {
  if (!faults_.empty()) wait();
}

void FaultInjector::wait() {
  const double now_s = player_.now_s(), next_s = faults_.next_change_s(now_s);
  constexpr double settling_s = 1;  // time after a fault during which delayed data are sent, s
  if (faults_.any_at(now_s))
    settled_s_ = std::max(settled_s_, now_s + settling_s + amount(FaultKind::late).value_or(0));
  if (std::isinf(next_s) && now_s > settled_s_) return;
  HostTime at = now() + poll_pause;
  // If no fault is active, polls one microsecond after the next fault starts, because times are
  // rounded.
  if (now_s > settled_s_)
    at = std::max(at, player_.start() + from_seconds(next_s) + std::chrono::microseconds(1));
  timer_.at(at, [this] {
    log_changes();
    on_poll_();
    wait();
  });
}

void FaultInjector::log_changes() {
  const double now_s = player_.now_s();
  if (logged_s_ >= 0 && now_s < faults_.next_change_s(logged_s_)) return;
  for (const auto& change : faults_.changes(logged_s_, now_s)) {
    const std::string what =
        std::string(change.begins ? "begin " : "end ") + name_of(change.fault->kind);
    log(player_.start() + from_seconds(change.time_s), what.c_str(),
        {{"amount_1e6", std::llround(1e6 * change.fault->amount)}});
  }
  logged_s_ = now_s;
}

bool FaultInjector::triggers(FaultKind kind) {
  const auto share = amount(kind);
  return share && std::uniform_real_distribution<double>(0, 1)(rng_) < *share;
}

std::size_t FaultInjector::corrupt(Bytes& bytes) {
  const std::size_t at = rng_() % bytes.size();
  bytes[at] ^= static_cast<std::uint8_t>(1 + rng_() % 255);
  return at;
}

Bytes FaultInjector::garbage() {
  Bytes bytes(static_cast<std::size_t>(amount(FaultKind::garbage).value_or(0)));
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(rng_());
  return bytes;
}

}  // namespace echofuse::sim

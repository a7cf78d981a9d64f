// SPDX-License-Identifier: MIT
#include "sim/devices/fault_injector.hpp"

#include <cmath>

namespace echofuse::sim {
namespace {

constexpr auto poll_pause = std::chrono::milliseconds(5);

}  // namespace

FaultInjector::FaultInjector(boost::asio::io_context& io, ScenePlayer& player, const char* device,
                             const FaultPlan& plan, std::uint64_t seed,
                             std::function<void()> on_poll)
    : player_(player),
      device_(device),
      faults_(plan.faults, device),
      journal_(plan.journal),
      rng_(make_rng(seed, 100 + static_cast<std::uint64_t>(device[0]))),
      timer_(io),
      on_poll_(std::move(on_poll)) {
  if (!faults_.empty()) wait();
}

void FaultInjector::wait() {
  timer_.expires_after(poll_pause);
  timer_.async_wait([this](const boost::system::error_code& error) {
    if (error) return;
    log_changes();
    on_poll_();
    wait();
  });
}

void FaultInjector::log_changes() {
  const double now_s = player_.now_s();
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

// SPDX-License-Identifier: MIT
// Injects faults into one device, and logs the faults and the sent data. Threading: use only in the
// thread of the event loop.
#pragma once
#include <functional>
#include <string>
#include <utility>

#include "drivers/core/bytes.hpp"
#include "drivers/core/random.hpp"
#include "drivers/port/loop.hpp"
#include "sim/devices/device.hpp"

namespace echofuse::sim {

class FaultInjector {
 public:
  // `device` is a string literal: tdc, radar or depth. `on_poll` is called when a fault starts or
  // ends, every 5 ms during a fault, and for at least one second after its end.
  FaultInjector(port::Loop& loop, ScenePlayer& player, const char* device, const FaultPlan& plan,
                std::uint64_t seed, std::function<void()> on_poll);

  void stop() { timer_.cancel(); }
  bool active(FaultKind kind) const { return amount(kind).has_value(); }
  std::optional<double> amount(FaultKind kind) const { return faults_.at(kind, player_.now_s()); }
  double gain() const { return amount(FaultKind::gain).value_or(1); }
  double clock_error_s(double time_s) const { return faults_.clock_error_s(time_s); }
  // During a fault of this kind, returns true with the probability amount(); otherwise returns
  // false.
  bool triggers(FaultKind kind);
  // Changes a random byte and returns its index.
  std::size_t corrupt(Bytes& bytes);
  // Returns the random bytes to be sent now; empty unless a `garbage` fault is active.
  Bytes garbage();
  std::uint64_t noise() { return rng_(); }
  HostTime now() const { return player_.now(); }
  // Returns the time at which data that are ready now must be sent: the current time or, during a
  // `late` fault, a later time.
  HostTime due() const { return now() + from_seconds(amount(FaultKind::late).value_or(0)); }

  void log(HostTime time, const char* what, SentLog::Numbers numbers) {
    if (sent_log_) sent_log_->put(time, device_, what, numbers);
  }

 private:
  void wait();
  void log_changes();

  ScenePlayer& player_;
  const char* device_;
  Faults faults_;
  SentLog* sent_log_;
  Rng rng_;
  port::Timer timer_;
  std::function<void()> on_poll_;
  double logged_s_ = -1, settled_s_ = 0;
};

}  // namespace echofuse::sim

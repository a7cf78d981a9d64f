// SPDX-License-Identifier: MIT
// Base of the drivers behind the bridge protocol. Axes arrive with the frames: a device is
// `streaming` from its first frame, and again after a change of its axes. A tagger has no axes and
// is `streaming` after its hello.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "drivers/bridge/bridge_client.hpp"

namespace echofuse::bridge {

class BridgeDriver : public Driver {
 public:
  void start(SampleSink& sink) override;
  void stop() override { client_.stop(); }
  std::vector<Counter> counters() const override;

 protected:
  BridgeDriver(Sensor sensor, port::Loop& loop, std::string address, port::ByteOpener opener);
  virtual void on_block(const Block& block, HostTime received) = 0;
  void announce(std::vector<Axis> axes, const Zones& zones = {});
  // Returns the frames missing before this one according to the device's numbers, which include
  // losses before the bridge and between connections; implausible numbers are replaced by the
  // bridge's.
  std::uint32_t lost_before(std::uint32_t number, const Block& block);

  BridgeClient client_;
  SampleSink* sink_ = nullptr;
  bool histograms_ = false;  // announced in a detector's hello
  Zones stated_zones_;       // stated in the hello
  std::uint64_t items_ = 0, lost_ = 0;

 private:
  void on_state(DeviceState state, const Hello& hello);

  DeviceInfo info_;
  std::optional<std::uint32_t> last_number_;
};

}  // namespace echofuse::bridge

// SPDX-License-Identifier: MIT
// Base of the drivers behind the bridge protocol. The axes come with the frames: a device is
// `streaming` from its first frame on, and again when its axes change. A tagger, which has none,
// is `streaming` from its hello on.
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
  // Returns the frames missing before this one by the device's own numbers, which also count what
  // it lost before the bridge and without one; by the bridge's where they make no sense.
  std::uint32_t lost_before(std::uint32_t number, const Block& block);

  BridgeClient client_;
  SampleSink* sink_ = nullptr;
  bool histograms_ = false;  // the hello of a detector announces them
  Zones stated_zones_;       // in the hello
  std::uint64_t items_ = 0, lost_ = 0;

 private:
  void on_state(DeviceState state, const Hello& hello);

  DeviceInfo info_;
  std::optional<std::uint32_t> last_number_;
};

}  // namespace echofuse::bridge

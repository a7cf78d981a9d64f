// SPDX-License-Identifier: MIT
// Base class of the drivers that use the bridge protocol. Axes arrive with the frames. So the
// state of a device is `streaming` from its first frame, and is reported again if its axes change.
// A tagger has no axes; its state is `streaming` once its hello block has arrived.
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
  void announce(std::vector<Axis> axes);
  // Returns the number of frames missing before this one, computed from the device's frame numbers,
  // including frames lost before they reached the bridge and frames lost between connections.
  // If the frame numbers are implausible, returns the losses counted by the bridge and the
  // protocol.
  std::uint32_t lost_before(std::uint32_t number, const Block& block);

  BridgeClient client_;
  SampleSink* sink_ = nullptr;
  bool histograms_ = false;  // true if the hello announces histograms instead of tags
  Hello hello_;
  std::uint64_t items_ = 0, lost_ = 0;

 private:
  void on_state(DeviceState state, const Hello& hello);

  DeviceInfo info_;
  std::optional<std::uint32_t> last_number_;
};

}  // namespace echofuse::bridge

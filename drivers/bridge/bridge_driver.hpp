// SPDX-License-Identifier: MIT
// Driver of a detector, radar or camera that uses the bridge protocol, over TCP or USB. The hello
// of a detector determines whether it sends tags or histograms. A radar sends range profiles of
// linear power. Axes arrive with the frames. So the state of a device is `streaming` from its first
// frame, and is reported again if its axes change. A tagger has no axes; its state is `streaming`
// once its hello block has arrived.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "drivers/bridge/bridge_client.hpp"

namespace echofuse::bridge {

class BridgeDriver final : public Driver {
 public:
  BridgeDriver(Sensor sensor, port::Loop& loop, std::string address, port::ByteOpener opener);
  void start(SampleSink& sink) override;
  void stop() override { client_.stop(); }
  std::vector<Counter> counters() const override;

 private:
  void on_state(DeviceState state, const Hello& hello);
  void on_block(const Block& block, HostTime received);
  // Each function passes the samples of a block to the sink. Returns the fault of an invalid block.
  std::string take_tags(const Block& block, HostTime received);
  std::string take_histogram(const Block& block, HostTime received);
  std::string take_profile(const Block& block, HostTime received);
  std::string take_depth(const Block& block, HostTime received);
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
  std::vector<Tag> scratch_;
  DeviceInfo info_;
  std::optional<std::uint32_t> last_number_;
};

}  // namespace echofuse::bridge

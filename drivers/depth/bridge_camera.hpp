// SPDX-License-Identifier: MIT
// A depth camera behind the bridge protocol.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "drivers/bridge/bridge_client.hpp"

namespace echofuse::depth {

// Its axes come with the frames, so it is `streaming` from the first frame on, and says so again
// when they change.
class BridgeCamera final : public Driver {
 public:
  BridgeCamera(port::Loop& loop, std::string address, port::ByteOpener opener);
  void start(SampleSink& sink) override;
  void stop() override { client_.stop(); }
  std::vector<Counter> counters() const override;

 private:
  void on_state(DeviceState state, const bridge::Hello& hello);
  void on_block(const bridge::Block& block, HostTime received);
  std::uint64_t lost_before(std::uint32_t index, const bridge::Block& block);

  bridge::BridgeClient client_;
  SampleSink* sink_ = nullptr;
  DeviceInfo info_;
  std::optional<std::uint32_t> last_index_;
  std::uint64_t frames_ = 0, lost_frames_ = 0;
};

}  // namespace echofuse::depth

// SPDX-License-Identifier: MIT
// Detector that uses the bridge protocol, over TCP or USB. Its hello determines whether it sends
// tags or histograms.
#pragma once
#include <string>
#include <vector>

#include "drivers/bridge/bridge_driver.hpp"

namespace echofuse::tdc {

class BridgeTdc final : public bridge::BridgeDriver {
 public:
  BridgeTdc(port::Loop& loop, std::string address, port::ByteOpener opener)
      : BridgeDriver(Sensor::spd, loop, std::move(address), std::move(opener)) {}

 private:
  void on_block(const bridge::Block& block, HostTime received) override;
  void on_tags(const bridge::Block& block, HostTime received);
  void on_histogram(const bridge::Block& block, HostTime received);

  std::vector<Tag> scratch_;
};

}  // namespace echofuse::tdc

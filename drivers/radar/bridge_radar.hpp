// SPDX-License-Identifier: MIT
// Radar that uses the bridge protocol and sends range profiles of linear power.
#pragma once
#include <string>

#include "drivers/bridge/bridge_driver.hpp"

namespace echofuse::radar {

class BridgeRadar final : public bridge::BridgeDriver {
 public:
  BridgeRadar(port::Loop& loop, std::string address, port::ByteOpener opener)
      : BridgeDriver(Sensor::radar, loop, std::move(address), std::move(opener)) {}

 private:
  void on_block(const bridge::Block& block, HostTime received) override;
};

}  // namespace echofuse::radar

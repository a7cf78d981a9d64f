// SPDX-License-Identifier: MIT
#pragma once
#include <string>

#include "drivers/bridge/bridge_driver.hpp"

namespace echofuse::depth {

class BridgeCamera final : public bridge::BridgeDriver {
 public:
  BridgeCamera(port::Loop& loop, std::string address, port::ByteOpener opener)
      : BridgeDriver(Sensor::depth, loop, std::move(address), std::move(opener)) {}

 private:
  void on_block(const bridge::Block& block, HostTime received) override;
};

}  // namespace echofuse::depth

// SPDX-License-Identifier: MIT
// A time tagger that speaks the bridge protocol, over TCP or USB.
#pragma once
#include <string>
#include <vector>

#include "drivers/bridge/bridge_client.hpp"

namespace echofuse::tdc {

class BridgeTdc final : public Driver {
 public:
  BridgeTdc(port::Loop& loop, std::string address, port::ByteOpener opener);
  void start(SampleSink& sink) override;
  void stop() override { client_.stop(); }
  std::vector<Counter> counters() const override;

 private:
  void on_block(const bridge::Block& block, HostTime received);

  std::string address_;
  bridge::BridgeClient client_;
  SampleSink* sink_ = nullptr;
  std::vector<Tag> scratch_;
  std::uint64_t tags_ = 0, lost_items_ = 0;
};

}  // namespace echofuse::tdc

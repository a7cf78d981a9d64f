// SPDX-License-Identifier: MIT
// Why does a radar that took its cfg send no frames? Its firmware is asked, on the command port:
//   queryDemoStatus         "Sensor State: 2" if it runs
//   sensorStop              configDataPort is not allowed while it runs
//   configDataPort BAUD 1   it writes 16 bytes FF to the data port (SDK 3.x, mmw_cli.c)
// Without ports and clocks: who uses it gives it `time` for all of that.
#pragma once
#include <chrono>
#include <cstdint>
#include <string>

#include "drivers/core/bytes.hpp"

namespace echofuse::radar {

class Silence {
 public:
  static constexpr std::chrono::seconds time{2};
  // `bytes`: what has come on the data port since the cfg was sent.
  Silence(std::uint32_t data_baud, std::uint64_t bytes);
  void receive_cli(ByteView bytes);
  void receive_data(ByteView bytes);
  std::string take_output();
  // The cause and its cure, in one line.
  std::string verdict() const;

 private:
  std::uint32_t data_baud_;
  std::uint64_t bytes_;
  int answered_ = 0;       // commands
  std::size_t pings_ = 0;  // bytes FF on the data port
  bool runs_ = false;
  std::string line_, output_;
};

}  // namespace echofuse::radar

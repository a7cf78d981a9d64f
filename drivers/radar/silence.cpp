// SPDX-License-Identifier: MIT
#include "drivers/radar/silence.hpp"

#include <algorithm>
#include <utility>

namespace echofuse::radar {

Silence::Silence(std::uint32_t data_baud, std::uint64_t bytes)
    : data_baud_(data_baud), bytes_(bytes), output_("queryDemoStatus\n") {}

void Silence::receive_cli(ByteView bytes) {
  constexpr std::size_t longest = 512;
  for (const std::uint8_t byte : bytes) {
    if (byte == '\n' || byte == '\r' || line_.size() > longest) line_.clear();
    line_ += static_cast<char>(byte);
    runs_ = runs_ || line_.ends_with("Sensor State: 2");
    if (!line_.ends_with(":/>")) continue;
    line_.clear();
    ++answered_;
    if (answered_ == 1) output_ += "sensorStop\n";
    if (answered_ == 2) output_ += "configDataPort " + std::to_string(data_baud_) + " 1\n";
  }
}

void Silence::receive_data(ByteView bytes) {
  bytes_ += bytes.size();
  if (answered_ >= 2) pings_ += static_cast<std::size_t>(std::ranges::count(bytes, 0xff));
}

std::string Silence::take_output() { return std::exchange(output_, {}); }

std::string Silence::verdict() const {
  constexpr std::size_t most_of_16 = 12;
  if (answered_ == 0)
    return "the firmware answers no more: its processor has stopped; reset the board, and ask for "
           "less in guiMonitor or for a longer frame";
  if (!runs_)
    return "the firmware says that the sensor does not run: reset the board, its cfg is sent again";
  if (answered_ < 2)
    return "the sensor does not stop: its signal processor has stopped; reset the board, and ask "
           "for less in guiMonitor or for a longer frame";
  if (pings_ >= most_of_16)
    return "the data port works, but no frame is sent: the image is for another board (an ISK's on "
           "an AOP or ODS, or the other way round), or its signal processor has stopped; flash the "
           "demo of this board";
  if (bytes_ > 0)
    return std::to_string(bytes_) +
           " bytes came that are no frames: is radar.data_baud the rate of the firmware's data "
           "port?";
  return "nothing arrives there, also not what the firmware writes for a test: radar.data is "
         "another port (of the board's two it is the one with the higher interface number), or its "
         "wire is loose";
}

}  // namespace echofuse::radar

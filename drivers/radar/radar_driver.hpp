// SPDX-License-Identifier: MIT
// A TI mmWave radar on two byte ports: the cfg goes out on the command port, frames come in on the
// data port.
#pragma once
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "drivers/core/driver.hpp"
#include "drivers/port/backoff.hpp"
#include "drivers/port/byte_port.hpp"
#include "drivers/port/timer.hpp"
#include "drivers/radar/command_dialogue.hpp"
#include "drivers/radar/frame_parser.hpp"

namespace echofuse::radar {

struct RadarSetup {
  std::string address;  // for DeviceInfo: both ports
  port::ByteOpener cli, data;
  std::string cfg_text, cfg_name;
  std::vector<std::string> warnings{};  // told at the start
};

// Each connection opens both ports and sends the whole cfg again. It is `streaming` from the first
// frame on. Silence of the data port, an end of either port, or a refused command makes it
// `faulted`, and it starts over.
class RadarDriver final : public Driver {
 public:
  // Throws Error(config) for a cfg that cannot work.
  RadarDriver(boost::asio::io_context& io, RadarSetup setup, const Clock& clock);
  void start(SampleSink& sink) override;
  void stop() override;
  std::vector<Counter> counters() const override;

 private:
  void connect();
  void on_opened();
  void advance();
  void on_cli(ByteView bytes);
  void on_data(ByteView bytes);
  void on_frame(RadarFrame frame);
  void watch();
  void fail(const std::string& why);
  void disconnect();

  RadarSetup setup_;
  const Clock& clock_;
  RadarProfile profile_;
  DeviceInfo info_;
  port::Timer dialogue_timer_, watch_timer_;
  port::Backoff backoff_;
  FrameParser parser_;
  std::optional<CommandDialogue> dialogue_;
  SampleSink* sink_ = nullptr;
  std::string last_failure_;    // told once, not at every attempt
  std::set<std::string> told_;  // warnings of the ports: each once
  int open_ports_ = 0;
  bool running_ = false, faulted_ = false, streaming_ = false, alive_ = false;
  std::uint64_t connections_ = 0, configured_ = 0, port_losses_ = 0;
  std::unique_ptr<port::BytePort> cli_, data_;
};

}  // namespace echofuse::radar

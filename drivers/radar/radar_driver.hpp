// SPDX-License-Identifier: MIT
// A TI mmWave radar on two byte ports: the cfg goes out on the command port, frames come in on the
// data port.
#pragma once
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/port/backoff.hpp"
#include "drivers/port/byte_port.hpp"
#include "drivers/port/loop.hpp"
#include "drivers/radar/command_dialogue.hpp"
#include "drivers/radar/frame_parser.hpp"
#include "drivers/radar/profile.hpp"

namespace echofuse::radar {

// Why does a radar that took its cfg send no frames? Its firmware is asked, on the command port:
//   queryDemoStatus         "Sensor State: 2" if it runs
//   sensorStop              configDataPort is not allowed while it runs
//   configDataPort BAUD 1   it writes 16 bytes FF to the data port (SDK 3.x, mmw_cli.c)
// Without ports and clocks: who uses it gives it `time` for all of that.
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

struct RadarSetup {
  std::string address;  // for DeviceInfo: both ports
  port::ByteOpener cli, data;
  std::string cfg_text, cfg_name;
  std::vector<std::string> warnings{};  // told at the start
  std::uint32_t data_baud = 921600;     // for the cfg's warnings
  Board board = Board::isk;             // for the antennas of its heat map
  port::Backoff backoff{};
  DialogueTimeouts timeouts{};
  bool keep_running = false;  // leave the sensor as it is at the end
};

// Each connection opens both ports and sends the whole cfg; or restarts the sensor with the cfg
// that it has, if a port was away for less than 10 s and nothing else was wrong. It is `streaming`
// from the first frame on. If none comes, the firmware is asked why (Silence). Silence of the
// data port, an end of either port, a refused command, or a board that was reset (its banner, or
// frame numbers that begin again) makes it `faulted`, and it starts over. At the end it is told to
// stop: finished() when it says that it has. A frame whose heat map is not that of the cfg and the
// board is delivered without it, and counted.
class RadarDriver final : public Driver {
 public:
  // Throws Error(config) for a cfg that cannot work.
  RadarDriver(port::Loop& loop, RadarSetup setup);
  void start(SampleSink& sink) override;
  void stop() override;
  bool finished() const override { return !last_words_ || last_words_->done(); }
  std::vector<Counter> counters() const override;

 private:
  void connect();
  void on_opened();
  void advance();
  void on_cli(ByteView bytes);
  void on_data(ByteView bytes);
  void on_frame(RadarFrame frame);
  void discard(const RadarFrame& frame);
  void check_array(RadarFrame& frame);
  void watch();
  void ask_why();
  void advance_silence();
  bool board_was_reset();
  void advance_last_words();
  void on_gone(const Failure& failure);
  void fail(const std::string& reason);
  void stop_timers();
  void disconnect();
  void drop_data();

  RadarSetup setup_;
  port::Loop& loop_;
  RadarProfile profile_;
  DeviceInfo info_;
  port::Timer dialogue_timer_, watch_timer_, quiet_timer_;
  port::Backoff backoff_;
  FrameParser parser_;
  std::optional<CommandDialogue> dialogue_;
  std::optional<Silence> silence_;  // while the firmware is asked why no frame has come
  std::optional<StopDialogue> last_words_;
  SampleSink* sink_ = nullptr;
  bool answered_ = false;  // ever
  std::string said_;       // last failure since a frame came; later failures do not hide it
  std::set<std::string> reported_;     // warnings of the ports: each once
  std::optional<HostTime> unplugged_;  // since then, with our cfg in the firmware
  std::uint64_t restarts_seen_ = 0, frames_before_ = 0, bytes_before_ = 0;
  int open_ports_ = 0;
  bool running_ = false, faulted_ = false, streaming_ = false, array_told_ = false;
  HostTime alive_{};             // the last frame, or the start
  std::uint32_t discarded_ = 0;  // frames, not yet told as lost
  std::uint64_t connections_ = 0, configured_ = 0, restarted_ = 0, early_frames_ = 0,
                port_losses_ = 0, bad_arrays_ = 0;
  std::unique_ptr<port::BytePort> cli_, data_;
};

}  // namespace echofuse::radar

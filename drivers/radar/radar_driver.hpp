// SPDX-License-Identifier: MIT
// TI mmWave radar on two byte ports: sends the cfg to the command port and reads frames from the
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

// Diagnoses a radar that accepted its cfg but sends no frames, by queries on the command port:
//   queryDemoStatus         "Sensor State: 2" if the sensor is running
//   sensorStop              required before configDataPort
//   configDataPort BAUD 1   sends 16 bytes FF to the data port (SDK 3.x, mmw_cli.c)
// Has no ports or clocks; the caller waits for `time`.
class Silence {
 public:
  static constexpr std::chrono::seconds time{2};
  // `bytes`: received on the data port since the cfg was sent.
  Silence(std::uint32_t data_baud, std::uint64_t bytes);
  void receive_cli(ByteView bytes);
  void receive_data(ByteView bytes);
  std::string take_output();
  // Returns cause and remedy in one line.
  std::string verdict() const;

 private:
  std::uint32_t data_baud_;
  std::uint64_t bytes_;
  int answered_ = 0;       // answered commands
  std::size_t pings_ = 0;  // FF bytes received on the data port
  bool runs_ = false;
  std::string line_, output_;
};

struct RadarSetup {
  std::string address;  // addresses of both ports, for DeviceInfo
  port::ByteOpener cli, data;
  std::string cfg_text, cfg_name;
  std::vector<std::string> warnings{};  // reported at the start
  std::uint32_t data_baud = 921600;     // for the checks of the cfg
  Board board = Board::isk;             // selects the antennas of the heat map
  port::Backoff backoff{};
  DialogueTimeouts timeouts{};
  bool keep_running = false;  // do not stop the sensor at the end
};

// Each connection opens both ports and sends the whole cfg. If a port was away for less than 10 s
// without another fault, it restarts the sensor with the stored cfg instead. The state is
// `streaming` after the first frame. Without frames, Silence determines the reason.
// The state becomes `faulted`, and the driver reconnects, if the data port is silent, a port
// closes, a command is refused, or the board was reset (banner, or frame numbers that restart).
// The state becomes `misconfigured` if frames arrive while the sensor is stopped.
// stop() sends `sensorStop`; finished() is true when the firmware confirms it. A frame with a heat
// map that contradicts cfg and board is delivered without the heat map, and counted.
class RadarDriver final : public Driver {
 public:
  // Throws Error(config) for an invalid cfg.
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
  void check_period(const RadarFrame& frame);
  void watch();
  void ask_why();
  void advance_silence();
  bool board_was_reset();
  void advance_last_words();
  void on_gone(const Failure& failure);
  void detect_other_board(const RadarFrame& frame);
  void check_frames();
  void fail(const std::string& reason, DeviceState state = DeviceState::faulted);
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
  std::optional<Silence> silence_;  // exists during the diagnosis of a missing first frame
  std::optional<StopDialogue> last_words_;
  SampleSink* sink_ = nullptr;
  bool answered_ = false;  // since the driver was created
  std::string said_;       // first failure since the last frame; later failures do not replace it
  std::set<std::string> reported_;     // warnings of the ports, each reported once
  std::optional<HostTime> unplugged_;  // time of an unplug with our cfg in the firmware
  std::uint64_t restarts_seen_ = 0, frames_before_ = 0, bytes_before_ = 0;
  struct FrameCount {
    std::uint32_t number = 0, cycles = 0;
  };
  FrameCount last_frame_;
  int odd_periods_ = 0;  // successive ones; stays at the number that was reported
  struct DriverFault {
    std::string reason;
    DeviceState state = DeviceState::faulted;
  };
  std::optional<DriverFault> fault_;
  std::optional<std::uint32_t> frame_after_stop_;  // number of the first frame after sensorStop
  int open_ports_ = 0;
  bool running_ = false, faulted_ = false, streaming_ = false, array_told_ = false;
  HostTime alive_{};             // time of the last frame, or of the start
  std::uint32_t discarded_ = 0;  // dropped frames, not yet reported as lost
  std::uint64_t connections_ = 0, configured_ = 0, restarted_ = 0, early_frames_ = 0,
                port_losses_ = 0, bad_arrays_ = 0;
  std::unique_ptr<port::BytePort> cli_, data_;
};

}  // namespace echofuse::radar

// SPDX-License-Identifier: MIT
// Driver of a TI mmWave radar with two byte ports. Sends the cfg to the command port and reads
// frames from the data port.
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

// Determines why a radar that accepted its cfg sends no frames. Sends commands to the command port:
//   queryDemoStatus         answers "Sensor State: 2" if the sensor is running
//   sensorStop              is required before configDataPort
//   configDataPort BAUD 1   sends 16 bytes FF to the data port (SDK 3.x, mmw_cli.c)
// Uses no ports or clocks; the caller waits for `time`.
class NoDataProbe {
 public:
  static constexpr std::chrono::seconds time{2};
  // `bytes`: number of bytes received on the data port since the cfg was sent.
  NoDataProbe(std::uint32_t data_baud, std::uint64_t bytes);
  void receive_cli(ByteView bytes);
  void receive_data(ByteView bytes);
  std::string take_output();
  // Returns the cause and the remedy as one line of text.
  std::string cause() const;

 private:
  std::uint32_t data_baud_;
  std::uint64_t bytes_;
  int answered_ = 0;       // number of commands that have been answered
  std::size_t pings_ = 0;  // number of FF bytes received on the data port
  bool runs_ = false;
  std::string line_, output_;
};

struct RadarSetup {
  std::string address;
  port::ByteOpener cli, data;
  std::string cfg_text, cfg_name;
  std::vector<std::string> warnings{};  // warnings to be reported by start()
  std::uint32_t data_baud = 921600;     // baud rate of the data port, used to check the cfg
  Board board = Board::isk;             // board type, which determines the antennas of the heat map
  port::Backoff backoff{};
  DialogueTimeouts timeouts{};
  bool keep_running = false;  // true: the radar keeps running when the driver stops
};

// Each connection opens both ports and sends the whole cfg. If a port was unplugged for less than
// 10 s and there was no other fault, the driver restarts the sensor with its stored cfg instead.
// The state is `streaming` from the first frame on. If no frame arrives, NoDataProbe determines the
// reason. If the data port is silent, a port closes, a command is rejected, or the board was reset
// (banner, or restarted frame numbering), the state becomes `faulted` and the driver reconnects.
// The state becomes `misconfigured` if frames arrive while the sensor is stopped. stop() sends
// `sensorStop`; finished() returns true once the firmware has confirmed it. A heat map that does
// not match the cfg and the board is removed and counted; the rest of the frame is delivered.
class RadarDriver final : public Driver {
 public:
  // Throws Error(config) if the cfg is invalid.
  RadarDriver(port::Loop& loop, RadarSetup setup);
  void start(SampleSink& sink) override;
  void stop() override;
  bool finished() const override { return !stop_dialogue_ || stop_dialogue_->done(); }
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
  void start_no_data_probe();
  void send(const std::string& text);  // to the command port
  bool board_was_reset();
  void advance_stop_dialogue();
  void on_disconnected(const Failure& failure);
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
  // set while the driver determines why the first frame is missing
  std::optional<NoDataProbe> no_data_probe_;
  std::optional<StopDialogue> stop_dialogue_;
  SampleSink* sink_ = nullptr;
  bool answered_ = false;  // true if the firmware has answered since the driver was created
  std::string
      probe_failure_;  // first failure since the last frame; later failures are appended to it
  std::set<std::string> reported_;  // port warnings that have been reported
  // time at which a port was unplugged while the firmware still had the driver's cfg
  std::optional<HostTime> unplugged_;
  std::uint64_t restarts_seen_ = 0, frames_before_ = 0, bytes_before_ = 0;
  struct FrameCount {
    std::uint32_t number = 0, cycles = 0;
  };
  FrameCount last_frame_;
  // number of successive frames with an unexpected interval; no longer counted after the warning
  int odd_periods_ = 0;
  struct DriverFault {
    std::string reason;
    DeviceState state = DeviceState::faulted;
  };
  std::optional<DriverFault> fault_;
  // frame number of the first frame after sensorStop
  std::optional<std::uint32_t> frame_after_stop_;
  int open_ports_ = 0;
  bool running_ = false, faulted_ = false, streaming_ = false, array_reported_ = false;
  HostTime alive_{};             // time of the last frame, or time at which the sensor was started
  std::uint32_t discarded_ = 0;  // number of dropped frames that have not yet been reported as lost
  std::uint64_t connections_ = 0, configured_ = 0, restarted_ = 0, early_frames_ = 0,
                port_losses_ = 0, bad_arrays_ = 0;
  std::unique_ptr<port::BytePort> cli_, data_;
};

}  // namespace echofuse::radar

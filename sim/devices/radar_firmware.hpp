// SPDX-License-Identifier: MIT
// Simulates the command line of TI's out-of-box demos, SDK 3.4 to 3.6, following their source code:
// utils/cli, demo/xwr68xx/mmw/mss/mmw_cli.c, demo/xwr64xx/mmw/mmw_cli.c and uartsci.c. The
// simulation includes the echo, the prompt and the replies. It checks which commands are required
// before a start, and which cannot change after the first start. It uses no ports and no clock.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "sim/devices/radar_chirp.hpp"

namespace echofuse::sim {

// Outputs requested by guiMonitor and measureRangeBiasAndRxChanPhase.
struct RadarOutputs {
  bool objects = false, range_profile = false, heat_map = false, stats = false;
  bool measure_bias = false;
  double target_m = 0, search_m = 0;
};

// Variant of the demo. The ISK runs the demo for the signal processor (xWR68xx). The AOP and the
// ODS run the demo for the hardware accelerator (xWR64xx), which lacks the command bpmCfg.
enum class RadarDemo : bool { dsp, accelerator };

class RadarFirmware {
 public:
  using Write = std::function<void(const std::string&)>;
  // `cli` is called with the text sent to the command port, `data` with the bytes sent to the data
  // port. `sdk` is the minor version: 5 for SDK 3.5. SDK 3.4 lacks the command calibData.
  RadarFirmware(Write cli, Write data, unsigned sdk = 5, RadarDemo demo = RadarDemo::dsp);

  void boot();
  // Receives bytes from the host. Bytes are lost while a command runs, because the UART buffers
  // only one byte. sensorStop runs until the current frame ends.
  void receive(ByteView bytes);
  void say(const std::string& text);

  // Chirp in use from sensorStart to the end of the frame during which sensorStop arrives;
  // otherwise empty.
  const std::optional<Chirp>& running() const { return running_; }
  // Returns the chirp of each subframe, in order. There is one subframe unless advFrameCfg
  // configures more.
  const std::vector<Chirp>& subframes() const { return subframes_; }
  const RadarOutputs& outputs() const { return outputs_; }
  unsigned data_baud() const { return data_baud_; }
  // Call between two frames. Completes a pending sensorStop.
  void between_frames();

 private:
  using CommandWords = std::vector<std::string>;
  // State of the demo, with the numbers printed by queryDemoStatus.
  enum class DemoState { init = 0, opened = 1, started = 2, stopped = 3 };

  void run_line();
  void prompt();
  void answer(int status);
  // Returns the status of a command; empty if the reply is sent later.
  std::optional<int> execute(const CommandWords& words);
  int configure(const CommandWords& words, const std::string& key);
  std::optional<int> sensor_start(const CommandWords& words);
  std::optional<int> sensor_stop();
  int config_data_port(const CommandWords& words);
  int gui_monitor(const CommandWords& words);
  int print_version();
  int print_status();
  std::string version() const;
  bool has_command(const std::string& command) const;
  bool all_pending();
  bool refuse_start(bool reconfigure);
  bool changed_latched();
  struct FramePart {
    // Indices of the first and last chirp, number of loops over these chirps per frame, and number
    // of frames (0: unlimited).
    unsigned first, last, loops, frames;
    double period_ms;
  };
  std::vector<Chirp> subframes_configured();
  bool ramps_possible();
  std::optional<Chirp> chirp(const FramePart& frame);
  unsigned subframe_count();

  Write cli_, data_;
  unsigned sdk_;
  RadarDemo demo_;
  std::string line_;
  DemoState state_ = DemoState::init;
  bool stopping_ = false, dead_ = false;
  unsigned data_baud_ = 921600;
  std::map<std::string, CommandWords> config_;  // words of the last accepted command of each kind
  // Commands with arguments that cannot be changed after the first start, and their words at that
  // start.
  std::map<std::string, CommandWords> latched_;
  std::vector<CommandWords> chirps_;
  // Words of profileCfg by profile number, and of subFrameCfg by subframe number.
  std::map<unsigned, CommandWords> profiles_, subframe_cfgs_;
  // required commands received since the last start, each with a subframe: "guiMonitor@0"
  std::set<std::string> pending_;
  std::optional<Chirp> running_;
  std::vector<Chirp> subframes_;
  RadarOutputs outputs_;
};

}  // namespace echofuse::sim

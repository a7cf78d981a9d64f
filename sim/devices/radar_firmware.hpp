// SPDX-License-Identifier: MIT
// Command line of TI's out-of-box demos, SDK 3.4 to 3.6, after their sources (utils/cli,
// demo/xwr68xx/mmw/mss/mmw_cli.c, demo/xwr64xx/mmw/mmw_cli.c, uartsci.c): echo, prompt, "Done",
// "Error -1", "Ignored: ...", the commands required before a start, and those fixed after the first
// one. It has no ports and no clock.
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

// outputs set by guiMonitor and measureRangeBiasAndRxChanPhase
struct RadarOutputs {
  bool objects = false, range_profile = false, heat_map = false, stats = false;
  bool measure_bias = false;
  double target_m = 0, search_m = 0;
};

// The ISK runs the signal processor's demo (xWR68xx). AOP and ODS run the hardware accelerator's
// (xWR64xx), which lacks bpmCfg.
enum class RadarDemo : bool { dsp, accelerator };

class RadarFirmware {
 public:
  using Write = std::function<void(const std::string&)>;
  // `cli` receives the text of the command port, `data` the bytes of the data port. `sdk` is the
  // minor version: 5 for SDK 3.5; SDK 3.4 lacks calibData.
  RadarFirmware(Write cli, Write data, unsigned sdk = 5, RadarDemo demo = RadarDemo::dsp);

  // Sends banner and prompt.
  void boot();
  // Receives bytes from the host. Bytes are lost while a command runs (a stop waits for the frame),
  // because the UART buffers only one byte.
  void receive(ByteView bytes);
  // Sends a line that the firmware prints on its own.
  void say(const std::string& text);

  // Chirp in use, from sensorStart to the end of the frame during which sensorStop arrived;
  // otherwise empty.
  const std::optional<Chirp>& running() const { return running_; }
  // Returns the chirp of each subframe, in order; one unless advFrameCfg sets more.
  const std::vector<Chirp>& subframes() const { return subframes_; }
  const RadarOutputs& outputs() const { return outputs_; }
  unsigned data_baud() const { return data_baud_; }
  // Reports that no frame is in progress, so that a pending sensorStop completes.
  void between_frames();

 private:
  using CommandWords = std::vector<std::string>;
  enum class DemoState {
    init = 0,
    opened = 1,
    started = 2,
    stopped = 3
  };  // state in
      // queryDemoStatus's numbers

  void run_line();
  void prompt();
  void answer(int status);
  std::optional<int> execute(const CommandWords& words);  // empty: the answer follows later
  int configure(const CommandWords& words, const std::string& key);
  std::optional<int> sensor_start(const CommandWords& words);
  std::optional<int> sensor_stop();
  int config_data_port(const CommandWords& words);
  int gui_monitor(const CommandWords& words);
  int print_version();
  int print_status();
  std::string version() const;
  bool knows(const std::string& command) const;
  bool all_pending() const;
  bool refuse_start(bool reconfigure);
  bool changed_latched();
  struct FramePart {
    unsigned first, last, loops, frames;  // chirps from first to last
    double period_ms;
  };
  std::vector<Chirp> subframes_configured();
  bool ramps_possible();
  std::optional<Chirp> chirp(const FramePart& frame, std::optional<unsigned> of_chirp);

  Write cli_, data_;
  unsigned sdk_;
  RadarDemo demo_;
  std::string line_;
  DemoState state_ = DemoState::init;
  bool stopping_ = false, dead_ = false;
  unsigned data_baud_ = 921600;
  std::map<std::string, CommandWords> config_;   // last accepted words of each command
  std::map<std::string, CommandWords> latched_;  // words at the first start
  std::vector<CommandWords> chirps_;
  std::map<unsigned, CommandWords> profiles_, subframe_cfgs_;  // by profile or chirp number
  CommandWords last_profile_;
  std::set<std::string> pending_;  // commands since the last start
  std::optional<Chirp> running_;
  std::vector<Chirp> subframes_;
  RadarOutputs outputs_;
};

}  // namespace echofuse::sim

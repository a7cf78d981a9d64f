// SPDX-License-Identifier: MIT
// Command line of TI's out-of-box demos, SDK 3.4 to 3.6, as their sources have it (utils/cli,
// demo/xwr68xx/mmw/mss/mmw_cli.c, demo/xwr64xx/mmw/mmw_cli.c, uartsci.c): echo, prompt, "Done",
// "Error -1", "Ignored: ...", what has to be configured before a start, and what may not change
// after the first one. It knows no ports and no time.
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

// guiMonitor and measureRangeBiasAndRxChanPhase set these outputs.
struct RadarOutputs {
  bool objects = false, range_profile = false, heat_map = false, stats = false;
  bool measure_bias = false;
  double target_m = 0, search_m = 0;
};

// The ISK runs the demo of the signal processor (xWR68xx). AOP and ODS run that of the hardware
// accelerator (xWR64xx), which knows no bpmCfg.
enum class RadarDemo : bool { dsp, accelerator };

class RadarFirmware {
 public:
  using Write = std::function<void(const std::string&)>;
  // `cli` gets the firmware's text on its command port, `data` raw bytes for the data port. `sdk`
  // is the 5 of SDK 3.5; before it there is no calibData.
  RadarFirmware(Write cli, Write data, unsigned sdk = 5, RadarDemo demo = RadarDemo::dsp);

  // At power-up it sends banner and prompt.
  void boot();
  // Takes bytes from the host. While a command runs (a stop waits for the frame) they are lost: the
  // UART has no buffer beyond one byte.
  void receive(ByteView bytes);
  // Sends a line of the firmware's own on the command port.
  void say(const std::string& text);

  // Chirp in use, from sensorStart to the end of the frame in which sensorStop came; else empty.
  const std::optional<Chirp>& running() const { return running_; }
  // Returns the chirp of each subframe; the subframes follow one another. There is one, unless
  // advFrameCfg says otherwise.
  const std::vector<Chirp>& subframes() const { return subframes_; }
  const RadarOutputs& outputs() const { return outputs_; }
  unsigned data_baud() const { return data_baud_; }
  // Tells that no frame is under way, so that a pending sensorStop completes.
  void between_frames();

 private:
  using Arguments = std::vector<std::string>;
  enum class State { init = 0, opened = 1, started = 2, stopped = 3 };  // as queryDemoStatus has it

  void run_line();
  void prompt();
  void answer(int status);
  std::optional<int> execute(const Arguments& words);  // empty if the answer comes later
  int configure(const Arguments& words, const std::string& key);
  std::optional<int> sensor_start(const Arguments& words);
  std::optional<int> sensor_stop();
  int config_data_port(const Arguments& words);
  int gui_monitor(const Arguments& words);
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
  State state_ = State::init;
  bool stopping_ = false, dead_ = false;
  unsigned data_baud_ = 921600;
  std::map<std::string, Arguments> config_;   // last good words of each command
  std::map<std::string, Arguments> latched_;  // words at the first start
  std::vector<Arguments> chirps_;
  std::map<unsigned, Arguments> profiles_, subframe_cfgs_;  // by their numbers
  Arguments last_profile_;
  std::set<std::string> pending_;  // configured since the last start
  std::optional<Chirp> running_;
  std::vector<Chirp> subframes_;
  RadarOutputs outputs_;
};

}  // namespace echofuse::sim

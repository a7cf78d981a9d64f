// SPDX-License-Identifier: MIT
// Dialogue with the command line of TI's mmWave demos (SDK utils/cli): a state machine without
// ports or clocks.
//
//   we send      the firmware answers (echo is on; in text mode a CR follows each LF)
//   "\n"         ["\n\r"] "mmwDemo:/>"
//                The line is repeated until no more input arrives.
//   "version\n"  echo, lines, "Done\n\r", "mmwDemo:/>"
//                The command is repeated once if other input precedes it.
//   "LINE\n"     echo, one of the following answers, then "mmwDemo:/>"
//                Done                                 success
//                Ignored: ... / Done                  success; the line is reported
//                Skipped                              success (a comment)
//                Error: REASON / Error -1             failure
//                Error -1 without a reason            failure: a front end limit is exceeded
//                'LINE' is not recognized as a CLI command
//                                                     failure; sdk.hpp explains it
//                ... Exception: FILE, line N.         failure: the firmware has stopped
//                nothing, or lines without a verdict  failure; the lines are reported
// Each line of the cfg is sent unchanged. The prompt must arrive before the next line is sent,
// because the firmware's receiver has no buffer. Unsolicited lines (calibration results) are
// reported unchanged. A banner in the middle of a dialogue means that the board was reset, which is
// a failure.
//
// A restart sends `sensorStop` and `sensorStart 0` instead of the cfg. The firmware then reuses its
// stored cfg. It refuses if it has no cfg (after a reset) or an incomplete one. In this case the
// whole cfg is sent.
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/core/sample.hpp"
#include "drivers/radar/profile.hpp"

namespace echofuse::radar {

struct DialogueTimeouts {
  std::chrono::milliseconds quiet{60};  // required silence between the prompt and the first command
  // maximum wait for the answer to an empty line; up to 3 empty lines are sent
  std::chrono::milliseconds prompt{1000};
  // maximum wait for the answer to a command; the firmware answers sensorStop only after the end of
  // a frame
  std::chrono::milliseconds answer{2000};
  // maximum wait for the answer to sensorStart, which first calibrates for several seconds
  std::chrono::milliseconds start{8000};
  // minimum time between the answer to sensorStop and the sending of sensorStart
  std::chrono::milliseconds pause{0};
};

class CommandDialogue {
 public:
  enum class State { draining, commanding, done, failed };
  struct LogLine {
    Severity severity;
    std::string text;
  };

  enum class Send { cfg, restart };

  CommandDialogue(std::string_view cfg_text, std::string cfg_name, DialogueTimeouts timeouts = {},
                  Send what = Send::cfg);

  void start(HostTime now);
  void receive(ByteView bytes, HostTime now);
  void tick(HostTime now);
  // Time at which tick() must be called; nullopt after success or failure.
  std::optional<HostTime> deadline() const { return deadline_; }

  State state() const { return state_; }
  // Arrival time of the answer to sensorStop; reset to nullopt when sensorStart is sent.
  std::optional<HostTime> stopped() const { return stopped_; }
  // Returns which commands were sent: the restart commands or the cfg. The cfg is also sent if the
  // firmware rejected the restart.
  Send sent() const { return send_; }
  bool answered() const { return answered_; }              // at least one prompt was received
  const std::string& failure() const { return failure_; }  // one line that contains the cfg line
  // Returns the bytes to be written to the port, and clears them.
  std::string take_output() { return std::exchange(output_, {}); }
  std::vector<LogLine> take_events() { return std::exchange(events_, {}); }
  // Returns the results of the board's calibration, and clears them.
  std::vector<FirmwareBias> take_biases() { return std::exchange(biases_, {}); }
  const std::string& remark() const { return remark_; }  // "Debug: ..." of a successful command
  // Platform and firmware version from the answer to `version`, for example "xWR68xx" and "mmWave
  // SDK 03.04.00.03". Empty if unknown.
  const std::string& platform() const { return platform_; }
  const std::string& firmware() const { return firmware_; }

 private:
  void on_line();
  void on_prompt(HostTime now);
  void check_answer(HostTime now);
  std::string advice(bool unknown, bool without_reason) const;
  void send_bare_line(HostTime now);
  void send_command(HostTime now);
  void next_command(HostTime now);
  void send_whole_cfg();
  bool is_probe() const { return next_ == 0; }
  bool starts() const { return commands_[next_].text.find("sensorStart") != std::string::npos; }
  void read_version(const std::string& line);
  void report(Severity severity, const std::string& text);
  void fail(const std::string& what);

  std::string cfg_name_;
  DialogueTimeouts timeouts_;
  // `commands_`: lines to send, beginning with the command `version` as line 0
  std::vector<CfgLine> cfg_, commands_;
  Send send_;
  std::size_t next_ = 0;  // index of the command that is waiting for its answer
  int tries_ = 0;
  State state_ = State::draining;
  bool received_bytes_ = false, answered_ = false;
  // `drain_end_`: latest time at which the wait for silence ends; set by the first prompt
  std::optional<HostTime> deadline_, drain_end_;
  std::optional<HostTime> stopped_;
  std::string line_;                 // text received since the last line ending or prompt
  std::vector<std::string> answer_;  // lines received since the command was sent
  std::string failure_, remark_, output_, platform_, firmware_;
  std::vector<LogLine> events_;
  std::vector<FirmwareBias> biases_;
};

// Sends `sensorStop` before the connection ends, so that the radar stops transmitting. Uses no port
// or clock; the caller enforces a time limit.
class StopDialogue {
 public:
  // `busy`: the firmware is executing a command and cannot buffer another command before the next
  // prompt.
  explicit StopDialogue(bool busy) : sent_(!busy) {
    if (sent_) output_ = line;
  }
  void receive(ByteView bytes);
  std::string take_output();
  // Returns true if the firmware has confirmed the stop.
  bool done() const { return done_; }

 private:
  static constexpr const char* line = "sensorStop\n";
  std::string answer_, output_;
  bool sent_, done_ = false;
};

}  // namespace echofuse::radar

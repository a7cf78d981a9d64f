// SPDX-License-Identifier: MIT
// The command line of TI's mmWave demos (SDK utils/cli), as a state machine without ports or
// clocks.
//
//   we send   the firmware answers (echo on; text mode puts CR after LF)
//   "\n"      ["\n\r"] "mmwDemo:/>"                          until it is quiet: leftovers are gone
//   "version\n"  echo, lines, "Done\n\r", "mmwDemo:/>"     may still meet garbage: sent twice at
//   most "LINE\n"  echo, then one of                            for each line of the cfg, verbatim
//               Done                                         good
//               Ignored: ... / Done                          good, told
//               Skipped                                      good (a comment)
//               Error -1 (often an explaining line before)   failed; bare: the front end's limits
//               'LINE' is not recognized as a CLI command    failed; sdk.hpp says why
//               ... Exception: FILE, line N.                 failed: the firmware has stopped
//               nothing, or lines without a verdict          failed, with these lines
//             "mmwDemo:/>"                                   before which nothing more is sent: the
//                                                            firmware's receiver has no buffer
// Lines that come unasked (calibration results) are told as they are. The firmware's banner where
// none belongs is a board that was reset, which is a failure.
//
// A restart sends `sensorStop` and `sensorStart 0` instead of the cfg: the firmware then runs with
// what it was given before, and refuses if it was given nothing (a board that was reset) or a part.
// In both cases the whole cfg follows.
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
  std::chrono::milliseconds quiet{60};     // after a prompt, before the first command
  std::chrono::milliseconds prompt{1000};  // for the answer to a bare line; tried 3 times
  std::chrono::milliseconds answer{2000};  // for a command: sensorStop waits for a frame's end
  std::chrono::milliseconds start{8000};   // for sensorStart, which calibrates for seconds
};

class CommandDialogue {
 public:
  enum class State { draining, commanding, done, failed };
  struct Event {
    Severity severity;
    std::string text;
  };

  enum class Send { cfg, restart };

  CommandDialogue(std::string_view cfg_text, std::string cfg_name, DialogueTimeouts timeouts = {},
                  Send what = Send::cfg);

  void start(HostTime now);
  void receive(ByteView bytes, HostTime now);
  void tick(HostTime now);
  // When tick() must be called at the latest; no value once done or failed.
  std::optional<HostTime> deadline() const { return deadline_; }

  State state() const { return state_; }
  // How it is or was done: Send::cfg also after a restart that was refused.
  Send sent() const { return send_; }
  bool answered() const { return answered_; }              // with a prompt, at least
  const std::string& failure() const { return failure_; }  // one line, with the cfg line's number
  // Takes the bytes to write since the last call.
  std::string take_output() { return std::exchange(output_, {}); }
  std::vector<Event> take_events() { return std::exchange(events_, {}); }
  // Takes the answers of the board's own calibration since the last call.
  std::vector<FirmwareBias> take_biases() { return std::exchange(biases_, {}); }
  const std::string& remark() const { return remark_; }  // "Debug: ...", of a command that worked
  // From the answer to `version`: "xWR68xx" and "mmWave SDK 03.04.00.03"; empty if it gave none.
  const std::string& platform() const { return platform_; }
  const std::string& firmware() const { return firmware_; }

 private:
  void on_line();
  void on_prompt(HostTime now);
  void judge_answer(HostTime now);
  std::string advice(bool unknown, bool without_reason) const;
  void send_bare_line(HostTime now);
  void send_command(HostTime now);
  void next_command(HostTime now);
  void send_whole_cfg();
  bool is_probe() const { return next_ == 0; }
  void read_version(const std::string& line);
  void report(Severity severity, const std::string& text);
  void fail(const std::string& what);

  std::string cfg_name_;
  DialogueTimeouts timeouts_;
  std::vector<CfgLine> cfg_, commands_;  // `version` first, as line 0
  Send send_;
  std::size_t next_ = 0;  // the command that is being answered
  int tries_ = 0;
  State state_ = State::draining;
  bool heard_ = false, answered_ = false;
  std::optional<HostTime> deadline_, drain_end_;  // drain_end_: set by the first prompt
  std::string line_;                              // since the last line end or prompt
  std::vector<std::string> answer_;               // the lines since it was sent
  std::string failure_, remark_, output_, platform_, firmware_;
  std::vector<Event> events_;
  std::vector<FirmwareBias> biases_;
};

// The last words to a radar: `sensorStop`, so that it does not radiate when nobody listens.
// As CommandDialogue without ports, and without clocks: who uses it gives up in time.
class StopDialogue {
 public:
  // `busy`: the firmware carries out a command. It has no room for another one until its prompt.
  explicit StopDialogue(bool busy) : sent_(!busy) {
    if (sent_) output_ = line;
  }
  void receive(ByteView bytes);
  std::string take_output();
  // The firmware answered that it has stopped.
  bool done() const { return done_; }

 private:
  static constexpr const char* line = "sensorStop\n";
  std::string answer_, output_;
  bool sent_, done_ = false;
};

}  // namespace echofuse::radar

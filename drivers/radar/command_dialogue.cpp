// SPDX-License-Identifier: MIT
#include "drivers/radar/command_dialogue.hpp"

#include <algorithm>

#include "drivers/radar/sdk.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::radar {
namespace {

// end of the prompt "mmwDemo:/>"; TI's lab demos print another word instead of mmwDemo
constexpr std::string_view prompt_end = ":/>";
constexpr std::size_t max_line = 512, max_answer_lines = 64;
constexpr std::size_t longest_answer = 4096;  // maximum length of the answer to sensorStop, bytes
constexpr int max_tries = 3;

std::string trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t");
  if (first == text.npos) return {};
  return std::string(text.substr(first, text.find_last_not_of(" \t") + 1 - first));
}

// Returns UART text as one line of limited length, for use in messages.
std::string shown(std::string_view text) { return printable(text, 256); }

bool has(const std::vector<std::string>& lines, std::string_view whole) {
  return std::find(lines.begin(), lines.end(), whole) != lines.end();
}

bool is_banner(const std::string& line) { return line.find(" MMW Demo ") != line.npos; }

bool is_refusal(const std::string& line) {
  return line.find("is not recognized as a CLI command") != line.npos;
}

// Returns the lines of the answer that explain a failure, as one string.
std::string explanation(const std::vector<std::string>& answer) {
  std::string text;
  for (const std::string& line : answer)
    if (line.starts_with("Error") || is_refusal(line)) text += (text.empty() ? "" : "; ") + line;
  return text;
}

}  // namespace

CommandDialogue::CommandDialogue(std::string_view cfg_text, std::string cfg_name,
                                 DialogueTimeouts timeouts, Send what)
    : cfg_name_(std::move(cfg_name)),
      timeouts_(timeouts),
      cfg_(command_lines(cfg_text)),
      commands_{{0, "version"}, {0, "sensorStop"}, {0, "sensorStart 0"}},
      send_(what) {
  if (what == Send::cfg) send_whole_cfg();
}

void CommandDialogue::send_whole_cfg() {
  send_ = Send::cfg;
  commands_.resize(1);
  commands_.insert(commands_.end(), cfg_.begin(), cfg_.end());
}

void CommandDialogue::start(HostTime now) { send_bare_line(now); }

void CommandDialogue::receive(ByteView bytes, HostTime now) {
  received_bytes_ = received_bytes_ || !bytes.empty();
  if (drain_end_ && !bytes.empty()) deadline_ = std::min(*drain_end_, now + timeouts_.quiet);
  for (const std::uint8_t byte : bytes) {
    if (byte == '\r' || byte == 0) continue;
    if (byte == '\n' || line_.size() >= max_line) {
      on_line();
      line_.clear();
      continue;
    }
    line_ += static_cast<char>(byte);
    if (line_.ends_with(prompt_end)) {
      line_.clear();
      on_prompt(now);
    }
  }
}

void CommandDialogue::tick(HostTime now) {
  if (!deadline_ || now < *deadline_) return;
  if (drain_end_) {
    drain_end_.reset();
    state_ = State::commanding;
    tries_ = 0;
    send_command(now);
  } else if (stopped_ && starts()) {
    send_command(now);
  } else if (state_ == State::draining && tries_ < max_tries) {
    send_bare_line(now);
  } else if (state_ == State::draining) {
    fail(received_bytes_
             ? "no prompt, but other bytes received; check that this is the command port and "
               "that the "
               "board's jumper is not set for flashing"
             : "no prompt; check that this is the radar's command port and that the board is "
               "powered, or "
               "reset the board");
  } else {
    if (!trimmed(line_).empty()) answer_.push_back(trimmed(line_));
    std::string answers;
    for (const std::string& line : answer_) answers += (answers.empty() ? " after '" : "; ") + line;
    fail("no answer" + (answers.empty() ? "" : shown(answers) + "'") +
         "; the firmware has stopped: reset the board");
  }
}

void CommandDialogue::on_line() {
  const std::string line = trimmed(line_);
  if (line.find_first_not_of('*') == line.npos || state_ == State::failed) return;
  const bool commanding = state_ == State::commanding;
  // The firmware sends this line once per frame while measureRangeBiasAndRxChanPhase is enabled.
  // The line may interrupt the echo of a command.
  const std::size_t bias_begin = line.find("compRangeBiasAndRxChanPhase ");
  if (line.find("Exception:") != line.npos) {
    fail(shown(line) + " (the firmware has stopped: reset the board" +
         (commanding && starts()
              ? "; channelCfg, adcCfg and lowPower can change only after a reset)"
              : ")"));
  } else if (is_banner(line) && state_ != State::draining) {
    fail("the board was reset");
  } else if (commanding && line == trimmed(commands_[next_].text)) {
    return;  // the line is the echo of the command
  } else if (bias_begin != line.npos) {
    const std::string bias_line = line.substr(bias_begin);
    report(Severity::info, bias_line);
    if (auto bias = parse_firmware_bias(bias_line)) biases_.push_back(std::move(*bias));
  } else if (state_ == State::draining) {
    if (is_banner(line)) send_whole_cfg();
    read_version(line);
  } else if (state_ == State::done) {
    report(Severity::info, line);
  } else {
    if (answer_.size() == max_answer_lines) answer_.erase(answer_.begin());
    answer_.push_back(line);
    if (is_probe()) read_version(line);
  }
}

void CommandDialogue::on_prompt(HostTime now) {
  if (state_ == State::commanding) {
    check_answer(now);
  } else if (state_ == State::draining && !drain_end_) {
    answered_ = true;
    drain_end_ = now + timeouts_.prompt;
    deadline_ = now + timeouts_.quiet;
  }
}

// Called at each prompt. If neither "Done" nor an error precedes the prompt, the prompt belongs to
// an earlier command, and the answer to the current command follows.
void CommandDialogue::check_answer(HostTime now) {
  const bool refused = std::any_of(answer_.begin(), answer_.end(), is_refusal);
  if (has(answer_, "Done") || has(answer_, "Skipped")) {
    const std::string& command = commands_[next_].text;
    // the firmware rejects sensorStop before the first start
    const bool stop = command.find("sensorStop") != command.npos;
    for (const std::string& line : answer_)
      if (line.starts_with("Ignored") || line.starts_with("Error"))
        report(stop ? Severity::info : Severity::warning, command + ": " + line);
      else if (line.starts_with("Debug"))
        remark_ = shown(line);
    if (stop) stopped_ = now;
    if (starts()) stopped_.reset();
    next_command(now);
  } else if (refused && is_probe() && tries_ < 2) {
    send_command(now);
  } else if (refused && is_probe()) {
    next_command(now);  // the firmware does not have the command `version`
  } else if (const std::string why = explanation(answer_); !why.empty() && send_ == Send::restart) {
    report(Severity::info, "restart refused, sending the cfg again: " + why);
    send_whole_cfg();
    next_ = 0;
    next_command(now);
  } else if (!why.empty()) {
    fail(shown(why) + advice(refused, why.starts_with("Error -")));
  }
}

std::string CommandDialogue::advice(bool unknown, bool without_reason) const {
  const std::string& command = commands_[next_].text;
  if (unknown) return advice_for_unknown(command, firmware_, cfg_name_);
  return starts() ? advice_for_start(cfg_, firmware_, cfg_name_, without_reason) : "";
}

void CommandDialogue::send_bare_line(HostTime now) {
  ++tries_;
  output_ += '\n';
  deadline_ = now + timeouts_.prompt;
}

void CommandDialogue::send_command(HostTime now) {
  if (starts() && stopped_ && now < *stopped_ + timeouts_.pause) {
    deadline_ = *stopped_ + timeouts_.pause;
    return;
  }
  if (starts()) stopped_.reset();
  ++tries_;
  answer_.clear();
  output_ += commands_[next_].text + '\n';
  deadline_ = now + (starts() ? timeouts_.start : timeouts_.answer);
}

void CommandDialogue::next_command(HostTime now) {
  tries_ = 0;
  if (++next_ < commands_.size()) return send_command(now);
  state_ = State::done;
  deadline_.reset();
}

// Reads the firmware's platform and SDK version from "mmWave SDK Version      : 03.04.00.03",
// "Platform                : xWR68xx", or the start-up banner "xWR68xx MMW Demo 03.04.00.03" (or
// xWR64xx).
void CommandDialogue::read_version(const std::string& line) {
  const std::size_t colon = line.find(':'), demo = line.find(" MMW Demo ");
  if (is_banner(line)) {
    platform_ = shown(line.substr(0, demo));
    firmware_ = shown(line.substr(demo + 1));
  } else if (colon != line.npos && line.starts_with("Platform")) {
    platform_ = shown(trimmed(std::string_view(line).substr(colon + 1)));
  } else if (colon != line.npos && line.starts_with("mmWave SDK Version")) {
    firmware_ = shown("mmWave SDK " + trimmed(std::string_view(line).substr(colon + 1)));
  }
}

void CommandDialogue::report(Severity severity, const std::string& text) {
  events_.push_back({severity, shown(text)});
}

void CommandDialogue::fail(const std::string& what) {
  const CfgLine& command = commands_[std::min(next_, commands_.size() - 1)];
  const bool sent = state_ == State::commanding;
  const std::string where =
      command.number ? cfg_name_ + ":" + std::to_string(command.number) + ": " : "";
  failure_ = (sent ? where + shown(command.text) + ": " : "") + what;
  state_ = State::failed;
  stopped_.reset();
  deadline_.reset();
  drain_end_.reset();
}

void StopDialogue::receive(ByteView bytes) {
  for (const std::uint8_t byte : bytes) {
    if (answer_.size() == longest_answer) answer_.clear();
    answer_ += static_cast<char>(byte);
    if (!answer_.ends_with(prompt_end)) continue;
    const std::string answer = std::exchange(answer_, {});
    if (!std::exchange(sent_, true))
      output_ = line;
    else  // a prompt without a verdict belongs to an earlier command
      done_ = done_ || answer.find("Done") != answer.npos;
  }
}

std::string StopDialogue::take_output() { return std::exchange(output_, {}); }

}  // namespace echofuse::radar

// SPDX-License-Identifier: MIT
#include "../catch.hpp"
#include "drivers/radar/command_dialogue.hpp"
#include "hex.hpp"

using namespace echofuse::radar;
using State = CommandDialogue::State;
using Send = CommandDialogue::Send;
using Texts = std::vector<std::string>;
using namespace std::chrono_literals;

namespace {

const std::string cfg =
    "% stock\r\n"
    "sensorStop\r\n"
    "\r\n"
    "  flushCfg\r\n"
    "sensorStart\r\n";
const std::string prompt = "mmwDemo:/>", partial = "Error: Full configuration must be provided";

std::string unknown(const std::string& command) {
  return "'" + command + "' is not recognized as a CLI command";
}

// Returns the echo, the answer and the prompt in the format in which the SDK's UART driver sends
// them in text mode.
std::string answer(const std::string& command, const std::string& lines = "Done\n") {
  std::string wire = command + "\r\n";
  for (const char c : lines) wire += c == '\n' ? "\n\r" : std::string(1, c);
  return wire + prompt;
}

struct Session {
  CommandDialogue d;
  HostTime now{0};

  explicit Session(const std::string& text = cfg, Send what = Send::cfg,
                   DialogueTimeouts timeouts = {})
      : d(text, "x.cfg", timeouts, what) {
    d.start(now);
  }
  // Both functions return what the dialogue then sends.
  std::string receive(const std::string& wire) {
    d.receive(test::view_of(wire), now);
    return d.take_output();
  }
  std::string wait(HostTime time) {
    now += time;
    d.tick(now);
    return d.take_output();
  }
  // Runs the dialogue up to the first line of the cfg. `greeting` precedes the first prompt.
  std::string begin(const std::string& sdk = "03.05.00.04", const std::string& greeting = "\r\n") {
    CHECK(receive(greeting + prompt) == "\n");
    CHECK(wait(59ms).empty());
    CHECK(wait(1ms) == "version\n");
    return receive(
        answer("version",
               "Platform                : xWR68xx\nmmWave SDK Version      : " + sdk + "\nDone\n"));
  }
  Texts reported() {
    Texts all;
    for (const auto& event : d.take_events()) all.push_back(event.text);
    return all;
  }
};

}  // namespace

TEST_CASE("radar cfg lines are sent one at a time, each after the board's prompt") {
  Session s;
  CHECK(s.begin() == "sensorStop\n");
  CHECK(s.receive(answer("sensorStop", "Ignored: Sensor is already stopped\nDone\n")) ==
        "  flushCfg\n");
  CHECK(s.reported() == Texts{"sensorStop: Ignored: Sensor is already stopped"});
  CHECK(s.receive("  flushCfg\r\nDone\n\r").empty());  // the board has not sent its prompt yet
  CHECK(s.receive(prompt) == "sensorStart\n");
  CHECK(s.d.state() == State::commanding);
  CHECK(s.wait(7999ms).empty());
  s.receive(answer("sensorStart", "Debug: Init Calibration Status = 0x1ffe\nDone\n"));
  CHECK(s.d.state() == State::done);
  CHECK_FALSE(s.d.deadline());
  CHECK(s.d.platform() + ", " + s.d.firmware() == "xWR68xx, mmWave SDK 03.05.00.04");
  CHECK(s.d.remark() == "Debug: Init Calibration Status = 0x1ffe");
  CHECK(s.reported().empty());
}

TEST_CASE("garbage and prompts that the radar sends before the first command are discarded") {
  Session s;
  s.receive("\x01\xff~?garb\r\n" + unknown("garb") + "\n\rxWR68xx MMW Demo 03.05.00.04\n\r" +
            prompt);
  CHECK(s.wait(40ms).empty());
  s.receive("\n\r" + prompt);  // a second prompt restarts the quiet period
  CHECK(s.wait(40ms).empty());
  CHECK(s.wait(40ms) == "version\n");
  CHECK(s.d.platform() + ", " + s.d.firmware() == "xWR68xx, MMW Demo 03.05.00.04");
  s.wait(2s);
  CHECK(s.d.failure() == "version: no answer; the firmware has stopped: reset the board");
}

TEST_CASE("the first cfg command is repeated once if garbage precedes it") {
  Session s;
  s.receive(prompt);
  s.wait(100ms);
  CHECK(s.receive(answer("\x7f?version", unknown("?version") + "\n")) == "version\n");
  // The firmware accepts the repeated command or does not know it.
  const std::string lines = GENERATE(std::string("Done\n"), unknown("version") + "\n");
  CHECK(s.receive(answer("version", lines)) == "sensorStop\n");
}

TEST_CASE("a radar cfg of another SDK is reported with both SDK versions and the file to use") {
  // Runs a cfg on a radar with SDK version `sdk`. The radar answers `words` to the last line.
  const auto failure = [](const std::string& text, const std::string& sdk, const Texts& words) {
    Session s(text);
    s.begin(sdk);
    s.receive(answer(command_lines(text)[0].text));
    std::string lines;
    for (const std::string& word : words) lines += word + "\n";
    s.receive(answer(command_lines(text)[1].text, lines));
    return s.d.failure();
  };
  CHECK(failure("flushCfg\ncalibData 0 0 0\n", "03.04.00.03", {unknown("calibData")}) ==
        "x.cfg:2: calibData 0 0 0: " + unknown("calibData") +
            "; only SDK 3.5 and 3.6 have this command, but this radar runs mmWave SDK 03.04.00.03: "
            "use a cfg for SDK 3.4, config/radar/xwr68xx_paper_50cm_sdk3.4.cfg");
  const std::string start = "x.cfg:2: sensorStart: ", refused = start + partial + "; Error -1";
  CHECK(failure("flushCfg\nsensorStart\n", "03.05.00.04", {partial, "Error -1"}) ==
        refused +
            "; the cfg is for SDK 3.4, because it has no calibData, but this radar runs mmWave SDK "
            "03.05.00.04: use a cfg for SDK 3.5, config/radar/xwr68xx_paper_50cm.cfg");
  CHECK_THAT(
      failure("flushCfg\nsensorStart\n", "03.04.00.03", {"Error -1"}),
      Catch::StartsWith(start + "Error -1; the chip's front end rejects the chirps or the frame") &&
          Catch::Contains("60 to 64 GHz"));
  // In these cases, the SDK version is not the cause of the failure.
  CHECK(failure("flushCfg\nsensorStart\n", "03.04.00.03", {partial, "Error -1"}) == refused);
  CHECK(failure("calibData 0 0 0\nsensorStart\n", "03.06.00.00", {partial, "Error -1"}) == refused);
}

TEST_CASE("a refused cfg line is reported with its number and the firmware's message") {
  const std::string stopped = "; the firmware has stopped: reset the board",
                    reset = " (the firmware has stopped: reset the board)";
  const auto [wire, failure] = GENERATE_COPY(table<std::string, std::string>(
      {{answer("flushCfg", partial + "\nError -1\n"), partial + "; Error -1"},
       {answer("flushCfg", unknown("flushCfg") + "\n"),
        unknown("flushCfg") +
            "; this radar runs mmWave SDK 03.05.00.04: is the cfg for a different demo?"},
       {"flushCfg\r\nMSS Exception: ../m.c, line 1.\n\r", "MSS Exception: ../m.c, line 1." + reset},
       {"flushCfg\r\nxWR68xx MMW Demo 03.05.00.04\n\r", "the board was reset"},
       {"flushCfg\r\n", "no answer" + stopped},
       {"flushCfg\r\nDebug: Init Calibration Status = 0xffe\n\rErro",
        "no answer after 'Debug: Init Calibration Status = 0xffe; Erro'" + stopped}}));
  Session s;
  s.begin();
  s.receive(answer("sensorStop"));
  s.receive(wire);
  if (failure.starts_with("no answer")) {
    s.wait(1999ms);
    CHECK(s.d.state() == State::commanding);
    s.wait(1ms);
  }
  CHECK(s.d.failure() == "x.cfg:4:   flushCfg: " + failure);
  CHECK(s.d.answered());
  CHECK(s.d.state() == State::failed);
  CHECK_FALSE(s.d.deadline());
}

TEST_CASE("the cfg dialogue fails after three attempts without a prompt and advises the user") {
  const auto [wire, failure] = GENERATE(table<std::string, std::string>(
      {{"", "no prompt; check that this is the radar's command port"},
       {"\n", "no prompt, but other bytes received; check that this is the command port"}}));
  Session s;
  CHECK(s.receive(wire) == "\n");
  for (const char* sent : {"\n", "\n", ""}) {
    CHECK(s.wait(999ms).empty());
    CHECK(s.wait(1ms) == sent);
  }
  CHECK(s.d.state() == State::failed);
  CHECK_THAT(s.d.failure(), Catch::StartsWith(failure));
  CHECK_FALSE(s.d.answered());
}

TEST_CASE("endless radar output before the first command does not block the cfg dialogue") {
  Session s;
  s.receive(prompt);
  for (int i = 0; i < 19; ++i) {
    s.receive("compRangeBiasAndRxChanPhase 0.01 1 0\n\r" + prompt);
    CHECK(s.wait(50ms).empty());
  }
  s.receive("compRangeBiasAndRxChanPhase 0.01 1 0\n\r");
  CHECK(s.wait(50ms) == "version\n");
}

TEST_CASE("the cfg dialogue accepts the answer Skipped and ignores other output and prompts") {
  Session s("sensorStop\nsensorStart\n");
  s.begin();
  s.receive(std::string(1'000'000, 'x') + "\n\r");  // uses bounded memory
  CHECK(s.receive("\n\r" + prompt).empty());
  CHECK(s.receive(answer("sensorStop", "Skipped\n")) == "sensorStart\n");
  const std::string bias = "compRangeBiasAndRxChanPhase 0.0123456 1.00000 0.00000",
                    incomplete = "compRangeBiasAndRxChanPhase 0.01";
  s.receive(answer("sensorStart", bias + "\nDone\n"));
  CHECK(s.d.state() == State::done);
  CHECK(s.reported() == Texts{bias});
  const auto biases = s.d.take_biases();
  REQUIRE(biases.size() == 1);
  CHECK(biases[0].range_bias_m == 0.0123456);
  CHECK(biases[0].re_im == std::vector{1.0, 0.0});
  s.receive(incomplete + "\n\rsome\x80thing\n\r");
  CHECK(s.reported() == Texts{incomplete, "some\\x80thing"});
  CHECK(s.d.take_biases().empty());
  s.receive("Exception: x.c, line 3.\n\r");
  CHECK(s.d.state() == State::failed);
}

TEST_CASE("a calibration line within a command echo is reported and otherwise ignored") {
  Session s("sensorStop\nsensorStart\n");
  const std::string bias = "compRangeBiasAndRxChanPhase 0.0123456 1.00000 -0.50000",
                    line = bias + "\n\r";
  // The board sends unsolicited output before the first command.
  s.receive(line + prompt + line);
  CHECK(s.wait(100ms) == "version\n");
  CHECK(s.reported() == Texts{bias, bias});
  s.receive(answer("version"));
  CHECK(s.receive("sensor" + line + "Stop\r\n" + line + "Done\n\r" + line + prompt) ==
        "sensorStart\n");
  CHECK(s.reported() == Texts{bias, bias, bias});
}

TEST_CASE("a radar restart sends two cfg lines, or the whole cfg after a refusal or a reboot") {
  Session s(cfg, Send::restart);
  const std::string what = GENERATE("accepted", "refused", "rebooted");
  const std::string banner = "******\n\rxWR68xx MMW Demo 03.05.00.04\n\r******\n\r";
  CHECK(s.begin("03.05.00.04", what == "rebooted" ? banner : "") == "sensorStop\n");
  if (what != "rebooted") {
    CHECK(s.receive(answer("sensorStop")) == "sensorStart 0\n");
    const bool refused = what == "refused";
    CHECK(s.receive(answer("sensorStart 0", refused ? partial + "\nError -1\n" : "Done\n")) ==
          (refused ? "sensorStop\n" : ""));
    const std::string reason = "restart refused, sending the cfg again: " + partial + "; Error -1";
    CHECK(s.reported() == (refused ? Texts{reason} : Texts{}));
  }
  CHECK(s.d.sent() == (what == "accepted" ? Send::restart : Send::cfg));
  if (what != "accepted")
    for (const char* line : {"sensorStop", "  flushCfg", "sensorStart"}) s.receive(answer(line));
  CHECK(s.d.state() == State::done);
}

TEST_CASE("sensorStop is sent after the prompt of the running command, and the answer is awaited") {
  const bool busy = GENERATE(false, true);
  StopDialogue d(busy);
  const auto receive = [&](const std::string& wire) { d.receive(test::view_of(wire)); };
  if (busy) {
    receive("Done\n\r");
    CHECK(d.take_output().empty());
    receive(prompt);
  }
  CHECK(d.take_output() == "sensorStop\n");
  receive("\r\n" + prompt);  // the prompt that follows an earlier command
  receive(answer("sensorStop", "Error -1\n"));
  for (const char c :
       answer("sensorStop", GENERATE("Done\n", "Ignored: Sensor is already stopped\nDone\n"))) {
    CHECK_FALSE(d.done());
    receive(std::string(1, c));
  }
  CHECK(d.done());
  CHECK(d.take_output().empty());
}

TEST_CASE("sensorStart is sent only after the pause that follows sensorStop") {
  Session s("sensorStop\nsensorStart\n", Send::cfg, {.pause = 300ms});
  s.begin();
  CHECK_FALSE(s.d.stopped());
  s.wait(20ms);
  const HostTime stopped = s.now;
  CHECK(s.receive(answer("sensorStop")).empty());
  CHECK(s.d.stopped() == stopped);
  CHECK(s.d.deadline() == stopped + 300ms);
  CHECK(s.wait(299ms).empty());
  CHECK(s.wait(1ms) == "sensorStart\n");
  CHECK_FALSE(s.d.stopped());
  s.receive(answer("sensorStart"));
  CHECK(s.d.state() == State::done);
}

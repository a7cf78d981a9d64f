// SPDX-License-Identifier: MIT
#include "../catch.hpp"
#include "drivers/radar/command_dialogue.hpp"
#include "hex.hpp"

using namespace echofuse::radar;
using State = CommandDialogue::State;
using namespace std::chrono_literals;

namespace {

const std::string cfg =
    "% stock\r\n"
    "sensorStop\r\n"
    "\r\n"
    "  flushCfg\r\n"
    "sensorStart\r\n";
const std::string prompt = "mmwDemo:/>";

// Returns the echo, the answer and the prompt in the format in which the SDK's UART driver sends
// them in text mode.
std::string answer(const std::string& command, const std::string& lines) {
  std::string wire = command + "\r\n";
  for (const char c : lines) {
    wire += c;
    if (c == '\n') wire += '\r';
  }
  return wire + prompt;
}

struct Session {
  CommandDialogue d;
  HostTime now{0};

  explicit Session(const std::string& text = cfg) : d(text, "x.cfg") { d.start(now); }
  void say(const std::string& wire) { d.receive(test::view_of(wire), now); }
  void wait(HostTime time) {
    now += time;
    d.tick(now);
  }
  // Runs the dialogue up to the point at which the first cfg line is sent.
  void begin() {
    CHECK(d.take_output() == "\n");
    say("\r\n" + prompt);
    wait(100ms);
    CHECK(d.take_output() == "version\n");
    say(answer("version",
               "Platform                : xWR68xx\nmmWave SDK Version      : 03.05.00.04\nDone\n"));
  }
  std::vector<std::string> reported() {
    std::vector<std::string> all;
    for (const auto& event : d.take_events()) all.push_back(event.text);
    return all;
  }
};

}  // namespace

TEST_CASE("radar cfg lines are sent one at a time, each after the board's prompt") {
  Session s;
  s.begin();
  CHECK(s.d.take_output() == "sensorStop\n");
  s.say(answer("sensorStop", "Ignored: Sensor is already stopped\nDone\n"));
  CHECK(s.reported() == std::vector<std::string>{"sensorStop: Ignored: Sensor is already stopped"});
  CHECK(s.d.take_output() == "  flushCfg\n");
  s.say("  flushCfg\r\nDone\n\r");
  CHECK(s.d.take_output().empty());  // no output, because the board has not sent its prompt yet
  s.say(prompt);
  CHECK(s.d.take_output() == "sensorStart\n");
  CHECK(s.d.state() == State::commanding);
  s.say(answer("sensorStart", "Debug: Init Calibration Status = 0x1ffe\nDone\n"));
  CHECK(s.d.state() == State::done);
  CHECK_FALSE(s.d.deadline());
  CHECK(s.d.platform() == "xWR68xx");
  CHECK(s.d.firmware() == "mmWave SDK 03.05.00.04");
  CHECK(s.reported().empty());
}

TEST_CASE("garbage and prompts that the radar sends before the first command are discarded") {
  Session s;
  s.d.take_output();
  s.say("\x01\xff~?garb\r\n'garb' is not recognized as a CLI command\n\r" + prompt);
  s.wait(40ms);
  s.say("\n\r" + prompt);  // a second prompt restarts the quiet period
  s.wait(40ms);
  CHECK(s.d.take_output().empty());
  s.wait(40ms);
  CHECK(s.d.take_output() == "version\n");
}

TEST_CASE("the first cfg command is repeated if garbage precedes it") {
  Session s;
  s.d.take_output();
  s.say(prompt);
  s.wait(100ms);
  CHECK(s.d.take_output() == "version\n");
  s.say(answer("\x7f?version", "'?version' is not recognized as a CLI command\n"));
  CHECK(s.d.take_output() == "version\n");
  SECTION("the dialogue continues if the repeated command is accepted") {
    s.say(answer("version", "Done\n"));
    CHECK(s.d.take_output() == "sensorStop\n");
  }
  SECTION("the dialogue continues if the firmware does not know the repeated command") {
    s.say(answer("version", "'version' is not recognized as a CLI command\n"));
    CHECK(s.d.take_output() == "sensorStop\n");
  }
}

namespace {
// Runs the cfg `text` on a radar with SDK version `sdk`. The radar answers `words` to the last
// line. Returns the error message.
std::string refusal(const std::string& text, const std::string& sdk, const std::string& words) {
  Session s(text);
  s.say("\r\n" + prompt);
  s.wait(100ms);
  s.say(answer("version", "mmWave SDK Version      : " + sdk + "\nDone\n"));
  const auto lines = command_lines(text);
  for (std::size_t i = 0; i + 1 < lines.size(); ++i) s.say(answer(lines[i].text, "Done\n"));
  s.say(answer(lines.back().text, words));
  return s.d.failure();
}
}  // namespace

TEST_CASE("a radar cfg of another SDK is reported with both SDK versions and the file to use") {
  const std::string unknown = "'calibData' is not recognized as a CLI command\n";
  CHECK(refusal("flushCfg\ncalibData 0 0 0\n", "03.04.00.03", unknown) ==
        "x.cfg:2: calibData 0 0 0: 'calibData' is not recognized as a CLI command; only SDK 3.5 "
        "and 3.6 have this command, but this radar runs mmWave SDK 03.04.00.03: use a cfg for SDK "
        "3.4, "
        "config/radar/xwr68xx_paper_50cm_sdk3.4.cfg");
  const std::string partial = "Error: Full configuration must be provided\nError -1\n";
  CHECK(
      refusal("flushCfg\nsensorStart\n", "03.05.00.04", partial) ==
      "x.cfg:2: sensorStart: Error: Full configuration must be provided; Error -1; the cfg is for "
      "SDK 3.4, because it has no calibData, but this radar runs mmWave SDK 03.05.00.04: use a cfg "
      "for "
      "SDK 3.5, config/radar/xwr68xx_paper_50cm.cfg");
  CHECK_THAT(refusal("flushCfg\nsensorStart\n", "03.04.00.03", "Error -1\n"),
             Catch::StartsWith("x.cfg:2: sensorStart: Error -1; the chip's front end rejects") &&
                 Catch::Contains("60 to 64 GHz"));
  // In these cases, the SDK version is not the cause of the failure.
  CHECK_THAT(refusal("flushCfg\nsensorStart\n", "03.04.00.03", partial),
             Catch::EndsWith("Error -1"));
  CHECK_THAT(refusal("calibData 0 0 0\nsensorStart\n", "03.06.00.00", partial),
             Catch::EndsWith("Error -1"));
}

TEST_CASE("a refused cfg line is reported with its number and the firmware's message") {
  const std::string stopped = "; the firmware has stopped: reset the board";
  const auto [wire, failure] = GENERATE_COPY(table<std::string, std::string>(
      {{answer("flushCfg", "Error: You have provided partial configuration\nError -1\n"),
        "Error: You have provided partial configuration; Error -1"},
       {answer("flushCfg", "'flushCfg' is not recognized as a CLI command\n"),
        "'flushCfg' is not recognized as a CLI command; this radar runs mmWave SDK 03.05.00.04: is "
        "the cfg for a different demo?"},
       {"flushCfg\r\nException: ../mss_main.c, line 1234.\n\r",
        "Exception: ../mss_main.c, line 1234. (the firmware"},
       {"flushCfg\r\nMSS Exception: ../mss/mss_main.c, line 635.\n\r",
        "MSS Exception: ../mss/mss_main.c, line"},
       {"flushCfg\r\n", "no answer" + stopped},
       {"flushCfg\r\nDebug: Init Calibration Status = 0xffe\n\rErro",
        "no answer after 'Debug: Init Calibration Status = 0xffe; Erro'" + stopped}}));
  Session s;
  s.begin();
  s.say(answer("sensorStop", "Done\n"));
  s.say(wire);
  if (failure.starts_with("no answer")) {
    s.wait(1900ms);
    CHECK(s.d.state() == State::commanding);
    s.wait(100ms);
  }
  CHECK_THAT(s.d.failure(), Catch::StartsWith("x.cfg:4:   flushCfg: " + failure));
  CHECK(s.d.answered());
  CHECK(s.d.state() == State::failed);
  CHECK_FALSE(s.d.deadline());
}

TEST_CASE("the cfg dialogue fails after three attempts without a prompt and advises the user") {
  Session s;
  for (int i = 0; i < 3; ++i) {
    CHECK(s.d.take_output() == "\n");
    s.wait(1s);
  }
  CHECK(s.d.state() == State::failed);
  CHECK_THAT(s.d.failure(),
             Catch::StartsWith("no prompt; check that this is the radar's command port"));
  CHECK_FALSE(s.d.answered());
  Session deaf;
  deaf.say("\n");
  for (int i = 0; i < 3; ++i) deaf.wait(1s);
  CHECK_THAT(deaf.d.failure(),
             Catch::StartsWith(
                 "no prompt, but other bytes received; check that this is the command port"));
}

TEST_CASE("endless radar output before the first command does not block the cfg dialogue") {
  Session s;
  s.d.take_output();
  s.say(prompt);
  for (int i = 0; i < 30 && s.d.state() == State::draining; ++i) {
    s.say("compRangeBiasAndRxChanPhase 0.01 1 0\n\r");
    s.wait(50ms);
  }
  CHECK(s.d.take_output() == "version\n");
}

TEST_CASE("the cfg dialogue accepts the answer Skipped as success and ignores extra prompts") {
  Session s("sensorStop\nsensorStart\n");
  s.begin();
  s.d.take_output();
  s.say("\n\r" + prompt);  // the board sends an extra prompt
  CHECK(s.d.take_output().empty());
  s.say(answer("sensorStop", "Skipped\n"));
  CHECK(s.d.take_output() == "sensorStart\n");
  s.say("sensorStart\r\ncompRangeBiasAndRxChanPhase 0.0123456 1.00000 0.00000\n\rDone\n\r" +
        prompt);
  CHECK(s.d.state() == State::done);
  CHECK(s.reported() ==
        std::vector<std::string>{"compRangeBiasAndRxChanPhase 0.0123456 1.00000 0.00000"});
  const auto biases = s.d.take_biases();
  REQUIRE(biases.size() == 1);
  CHECK(biases[0].range_bias_m == 0.0123456);
  s.say("compRangeBiasAndRxChanPhase 0.01\n\rsome\x80thing\n\r");
  CHECK(s.reported() ==
        std::vector<std::string>{"compRangeBiasAndRxChanPhase 0.01", "some\\x80thing"});
  CHECK(s.d.take_biases().empty());
  s.say("Exception: x.c, line 3.\n\r");
  CHECK(s.d.state() == State::failed);
}

TEST_CASE("a calibration line within a command echo is reported and otherwise ignored") {
  Session s("sensorStop\nsensorStart\n");
  const std::string line = "compRangeBiasAndRxChanPhase 0.0123456 1.00000 -0.50000";
  s.d.take_output();
  // The board sends unsolicited output before the first command.
  s.say(line + "\n\r" + prompt + line + "\n\r");
  s.wait(100ms);
  CHECK(s.reported() == std::vector<std::string>{line, line});
  CHECK(s.d.take_output() == "version\n");
  s.say(answer("version", "Done\n"));
  s.d.take_output();
  s.say("sensor" + line + "\n\rStop\r\n" + line + "\n\rDone\n\r" + line + "\n\r" + prompt);
  CHECK(s.reported() == std::vector<std::string>{line, line, line});
  CHECK(s.d.take_output() == "sensorStart\n");
}

TEST_CASE("a radar restart sends two cfg lines, or the whole cfg after a refusal or a reboot") {
  CommandDialogue d(cfg, "x.cfg", {}, CommandDialogue::Send::restart);
  const auto say = [&](const std::string& wire) { d.receive(test::view_of(wire), HostTime{0}); };
  d.start(HostTime{0});
  d.take_output();
  const bool booted = GENERATE(false, true);
  if (booted) say("******\n\rxWR68xx MMW Demo 03.05.00.04\n\r******\n\r");
  say(prompt);
  d.tick(100ms);
  say(answer("version", "Done\n"));
  say(answer("sensorStop", "Done\n"));
  if (booted) {
    CHECK(d.take_output() == "version\nsensorStop\n  flushCfg\n");
    CHECK(d.firmware() == "MMW Demo 03.05.00.04");
    return;
  }
  CHECK(d.take_output() == "version\nsensorStop\nsensorStart 0\n");
  SECTION("the restart is complete if the board accepts it") {
    say(answer("sensorStart 0", "Done\n"));
    CHECK(d.state() == State::done);
    CHECK(d.sent() == CommandDialogue::Send::restart);
  }
  SECTION("the whole cfg is sent if the board refuses the restart") {
    say(answer("sensorStart 0", "Error: Full configuration must be provided\nError -1\n"));
    CHECK(d.take_output() == "sensorStop\n");
    say(answer("sensorStop", "Done\n"));
    say(answer("  flushCfg", "Done\n"));
    say(answer("sensorStart", "Done\n"));
    CHECK(d.state() == State::done);
    CHECK(d.sent() == CommandDialogue::Send::cfg);
  }
}

TEST_CASE("the cfg dialogue ignores endless output without newlines and uses bounded memory") {
  Session s;
  s.begin();
  s.d.take_output();
  s.say(std::string(1'000'000, 'x'));
  s.say("\n\r" + answer("sensorStop", "Done\n"));
  CHECK(s.d.take_output() == "  flushCfg\n");
}

TEST_CASE("sensorStop is sent after the prompt of the running command, and the answer is awaited") {
  const bool busy = GENERATE(false, true);
  StopDialogue d(busy);
  if (busy) {
    CHECK(d.take_output().empty());
    d.receive(test::view_of("Done\n\r"));
    CHECK(d.take_output().empty());
    d.receive(test::view_of(prompt));
  }
  CHECK(d.take_output() == "sensorStop\n");
  d.receive(test::view_of("\r\n" + prompt));  // the prompt that follows an earlier command
  CHECK_FALSE(d.done());
  const std::string wire =
      answer("sensorStop", GENERATE("Done\n", "Ignored: Sensor is already stopped\nDone\n"));
  for (const char& c : wire) {
    CHECK_FALSE(d.done());
    d.receive(test::view_of(std::string(1, c)));
  }
  CHECK(d.done());
  CHECK(d.take_output().empty());
}

TEST_CASE("a sensorStop that the radar refuses does not count as a stop") {
  StopDialogue d(false);
  d.receive(test::view_of(answer("sensorStop", "Error -1\n")));
  CHECK_FALSE(d.done());
}

TEST_CASE("sensorStart is sent only after the pause that follows sensorStop") {
  CommandDialogue d("sensorStop\nsensorStart\n", "x.cfg", {.pause = 300ms});
  const auto say = [&](const std::string& wire, HostTime now) {
    d.receive(test::view_of(wire), now);
  };
  d.start(HostTime{0});
  say(prompt, HostTime{0});
  d.tick(100ms);
  say(answer("version", "Done\n"), 100ms);
  CHECK_FALSE(d.stopped());
  say(answer("sensorStop", "Done\n"), 120ms);
  CHECK(d.take_output() == "\nversion\nsensorStop\n");
  CHECK(d.stopped() == HostTime(120ms));
  CHECK(d.deadline() == HostTime(420ms));
  d.tick(419ms);
  CHECK(d.take_output().empty());
  d.tick(420ms);
  CHECK(d.take_output() == "sensorStart\n");
  CHECK_FALSE(d.stopped());
  say(answer("sensorStart", "Done\n"), 430ms);
  CHECK(d.state() == State::done);
}

// SPDX-License-Identifier: MIT
// Input: a byte, then the output of the firmware. The byte 'r' selects a restart, and any other
// byte selects a cfg. In the output, the byte 0x01 means a pause of 100 ms and 0x02 a pause of 9 s.
#include "drivers/radar/command_dialogue.hpp"
#include "fuzz.hpp"

using namespace echofuse::radar;
using namespace std::chrono_literals;

namespace {

constexpr std::string_view cfg = "sensorStop\n  flushCfg\r\nguiMonitor -1 0 1\nsensorStart\n";
const std::vector<std::string> cfg_lines = {"sensorStop", "  flushCfg", "guiMonitor -1 0 1",
                                            "sensorStart"};
constexpr std::size_t longest_text = 600, max_tries = 3;

struct Session {
  explicit Session(CommandDialogue::Send what) : dialogue(cfg, "x.cfg", {}, what) {
    dialogue.start(now);
    look();
  }
  CommandDialogue dialogue;
  HostTime now{0};
  std::vector<std::string> sent{}, events{};

  void receive(ByteView bytes) {
    dialogue.receive(bytes, now);
    look();
  }
  void wait(HostTime time) {
    now += time;
    dialogue.tick(now);
    look();
  }
  void look() {
    using State = CommandDialogue::State;
    const State state = dialogue.state();
    std::string line;
    for (const char c : dialogue.take_output()) {
      if (c != '\n') line += c;
      if (c == '\n') sent.push_back(std::exchange(line, {}));
    }
    require(line.empty(), "only complete lines are sent");
    for (const auto& event : dialogue.take_events()) events.push_back(event.text);
    for (const std::string& text : {dialogue.failure(), dialogue.platform(), dialogue.firmware()})
      require(fuzz::is_printable(text) && text.size() <= longest_text, "a text is one short line");
    require(dialogue.failure().empty() == (state != State::failed), "a failure has a reason");
    const bool waits = state == State::draining || state == State::commanding;
    require(dialogue.deadline().has_value() == waits, "every waiting state has a deadline");
  }
};

// Checks that the host sent empty lines first, then `version` at most twice, then the cfg lines in
// order. After a restart, the host sends two lines before the cfg.
void check_sent(const Session& s) {
  auto at = s.sent.begin();
  const auto many = [&](const std::string& line, std::size_t most) {
    std::size_t count = 0;
    for (; at != s.sent.end() && *at == line && count < most; ++at) ++count;
    return count > 0;
  };
  require(many("", max_tries), "the dialogue begins with an empty line");
  bool all = many("version", 2);
  if (all && s.sent.end() - at >= 1 && *at == "sensorStop" &&
      (s.dialogue.sent() == CommandDialogue::Send::restart ||
       (at + 1 != s.sent.end() && *(at + 1) != cfg_lines[1]))) {
    ++at;
    if (at != s.sent.end() && *at == "sensorStart 0") ++at;
  }
  for (const std::string& line : cfg_lines) all = all && many(line, 1);
  require(at == s.sent.end(), "nothing else is sent");
  const bool done = s.dialogue.state() == CommandDialogue::State::done;
  if (done && s.dialogue.sent() == CommandDialogue::Send::cfg)
    require(all, "done means that the whole cfg was sent");
}

}  // namespace

void fuzz::run(ByteView input) {
  if (input.empty()) return;
  const auto what = input[0] == 'r' ? CommandDialogue::Send::restart : CommandDialogue::Send::cfg;
  Session whole(what), bytewise(what);
  std::size_t prompts = 0, waits = 0;
  for (ByteView rest = input.subspan(1); !rest.empty();) {
    const auto end =
        std::find_if(rest.begin(), rest.end(), [](auto b) { return b == 1 || b == 2; });
    const ByteView bytes = rest.first(static_cast<std::size_t>(end - rest.begin()));
    whole.receive(bytes);
    for (std::size_t i = 0; i < bytes.size(); ++i) bytewise.receive(bytes.subspan(i, 1));
    prompts += static_cast<std::size_t>(std::count(bytes.begin(), bytes.end(), '>'));
    rest = rest.subspan(bytes.size());
    if (rest.empty()) break;
    for (Session* s : {&whole, &bytewise}) s->wait(rest[0] == 1 ? 100ms : 9000ms);
    ++waits;
    rest = rest.subspan(1);
    require(whole.sent.size() <= 1 + prompts + waits, "a command waits for the prompt before it");
  }
  require(whole.sent.size() <= 1 + prompts + waits, "a command waits for the prompt before it");
  require(whole.sent == bytewise.sent && whole.events == bytewise.events &&
              whole.dialogue.failure() == bytewise.dialogue.failure() &&
              whole.dialogue.state() == bytewise.dialogue.state() &&
              whole.dialogue.deadline() == bytewise.dialogue.deadline(),
          "any split gives the same dialogue");
  for (const std::string& text : whole.events)
    require(fuzz::is_printable(text) && text.size() <= longest_text, "an event is one line");
  check_sent(whole);
}

// SPDX-License-Identifier: MIT
// The radar's command line: whatever it answers, in whatever rhythm, the dialogue ends, and never
// writes what is not in the cfg.
#include "drivers/radar/command_dialogue.hpp"
#include "fuzz.hpp"

using namespace echofuse;
using namespace echofuse::fuzz;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::string_view cfg = "sensorStop\nflushCfg\nsensorStart\n";
  using radar::CommandDialogue;
  HostTime now{};
  CommandDialogue dialogue(cfg, "fuzz.cfg");
  dialogue.start(now);
  std::string written;
  const auto listen = [&] {
    written += dialogue.take_output();
    for (const auto& event : dialogue.take_events())
      require(event.text.find('\n') == std::string::npos, "an event is one line");
  };
  in_pieces({data, size}, [&](ByteView piece) {
    now += std::chrono::milliseconds(piece[0]);
    dialogue.receive(piece, now);
    dialogue.tick(now);
    listen();
  });
  for (int i = 0; dialogue.deadline(); ++i) {
    require(i < 1000, "silence ends the dialogue");
    now = std::max(now, *dialogue.deadline());
    dialogue.tick(now);
    listen();
  }
  const bool failed = dialogue.state() == CommandDialogue::State::failed;
  require(failed || dialogue.state() == CommandDialogue::State::done, "it is done or failed");
  require(failed == !dialogue.failure().empty(), "a failure says why");
  require(failed || written.ends_with(cfg), "a dialogue that is done sent the whole cfg");
  return 0;
}

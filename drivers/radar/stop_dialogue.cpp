// SPDX-License-Identifier: MIT
#include "drivers/radar/stop_dialogue.hpp"

#include <string_view>
#include <utility>

namespace echofuse::radar {
namespace {

constexpr std::string_view prompt_end = ":/>";
constexpr std::size_t longest_answer = 4096;

}  // namespace

void StopDialogue::receive(ByteView bytes) {
  for (const std::uint8_t byte : bytes) {
    if (answer_.size() == longest_answer) answer_.clear();
    answer_ += static_cast<char>(byte);
    if (!answer_.ends_with(prompt_end)) continue;
    const std::string answer = std::exchange(answer_, {});
    if (!std::exchange(sent_, true))
      output_ = line;
    else  // a prompt without a verdict is a leftover
      done_ = done_ || answer.find("Done") != answer.npos;
  }
}

std::string StopDialogue::take_output() { return std::exchange(output_, {}); }

}  // namespace echofuse::radar

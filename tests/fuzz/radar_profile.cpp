// SPDX-License-Identifier: MIT
// Input: a .cfg file.
#include <bit>
#include <cmath>
#include <optional>

#include "drivers/radar/profile.hpp"
#include "fuzz.hpp"

using namespace echofuse::radar;

namespace {

struct Outcome {
  std::optional<RadarProfile> profile;
  std::string fault;
};

Outcome outcome_of(const std::string& text) {
  Outcome out;
  out.fault = fuzz::faults_by("x.cfg:", [&] { out.profile = parse_profile(text, "x.cfg"); });
  return out;
}

void check_lines(const std::string& text) {
  const std::string_view all = text;
  int last = 0;
  for (const CfgLine& line : command_lines(text)) {
    require(line.number > last, "line numbers increase");
    last = line.number;
    const bool comment = line.text[line.text.find_first_not_of(" \t")] == '%';
    require(!comment && line.text.find_first_of("\r\n") == line.text.npos, "a command is one line");
  }
  require(last <= std::count(all.begin(), all.end(), '\n') + 1, "line numbers are within the file");
}

void check(const RadarProfile& p) {
  const bool known_size = std::has_single_bit(p.bins) || p.bins == 1022;
  require(known_size && p.adc_samples >= 2 && p.bins <= 2048 && p.bins + 2 >= p.adc_samples,
          "the number of bins matches the firmware's FFT");
  require(p.antennas >= 1 && p.antennas <= 12, "there are 1 to 12 virtual antennas");
  require(std::isfinite(p.range_step_m) && p.range_step_m > 0,
          "the range step is finite and positive");
  require(std::isfinite(p.frame_period_s) && p.frame_period_s > 0,
          "the frame period is finite and positive");
  require(p.frame_bytes >= 64 && p.frame_bytes % 32 == 0, "a frame is a multiple of 32 bytes");
  require(p.array.size() <= p.antennas, "a heat map has at most all antennas");
  for (const auto& lines : {p.warnings, p.refusals})
    for (const std::string& line : lines)
      require(line.starts_with("x.cfg:") && fuzz::is_printable(line), "a warning is one line");
}

bool same(const Outcome& a, const Outcome& b) {
  if (a.fault != b.fault || a.profile.has_value() != b.profile.has_value()) return false;
  return !a.profile ||
         (a.profile->range_step_m == b.profile->range_step_m &&
          a.profile->bins == b.profile->bins && a.profile->frame_bytes == b.profile->frame_bytes &&
          a.profile->frame_period_s == b.profile->frame_period_s &&
          a.profile->warnings == b.profile->warnings);
}

}  // namespace

void fuzz::run(ByteView input) {
  const std::string text(text_of(input));
  check_lines(text);
  const Outcome outcome = outcome_of(text);
  if (outcome.profile) check(*outcome.profile);
  std::string windows;
  for (const char c : text) windows += c == '\n' ? std::string("\r\n") : std::string(1, c);
  require(same(outcome, outcome_of(windows)), "line ends have no effect");
  require(same(outcome, outcome_of(text + "\n% comment\n \n")), "comments have no effect");
}

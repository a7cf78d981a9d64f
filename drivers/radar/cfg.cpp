// SPDX-License-Identifier: MIT
#include "drivers/radar/cfg.hpp"

#include <algorithm>
#include <bit>
#include <cctype>
#include <charconv>
#include <cmath>
#include <optional>
#include <utility>

#include "drivers/radar/demo_commands.hpp"
#include "drivers/radar/ramp.hpp"
#include "drivers/radar/sdk.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/settings.hpp"

namespace echofuse::radar {
namespace {

// Firmware limits on the number of characters and words in a line. Source: SDK, utils/cli and UART
// text mode.
constexpr std::size_t max_line = 255, max_words = 40;

// Maximum size of a cfg. The cfgs of TI's demos have sizes of 1 to 4 kB.
constexpr std::size_t max_cfg_bytes = 64 << 10;

constexpr unsigned max_subframes = 4;
constexpr auto npos = std::string_view::npos;

// Returns true if the command's first argument selects the subframe, or all subframes.
bool applies_to(const CfgCommand& c, unsigned subframe) {
  return c.words.size() > 1 && (c.words[1] == "-1" || c.words[1] == std::to_string(subframe));
}

std::string quoted(std::string_view word) { return std::string(1, '\'').append(word) += '\''; }

std::optional<double> to_number(std::string_view word) {
  double value = 0;
  const bool hex = word.starts_with("0x");
  const auto [end, error] =
      std::from_chars(word.data() + (hex ? 2 : 0), word.data() + word.size(), value,
                      hex ? std::chars_format::hex : std::chars_format::general);
  const bool whole = error == std::errc{} && end == word.data() + word.size();
  return whole && std::isfinite(value) ? std::optional(value) : std::nullopt;
}

std::string miscounted(const CfgCommand& c, std::size_t expected) {
  return "has " + std::to_string(c.words.size() - 1) + " numbers; SDK 3.4 to 3.6 expect " +
         std::to_string(expected) + " (SDK 1 and 2 differ)";
}

// Returns the command of a setting "profileCfg", "profileCfg/2" or "cfarCfg/0#3" (subframe 3).
std::string_view command_of(std::string_view setting) {
  return setting.substr(0, setting.find_first_of("/#"));
}

// Returns the setting in the form of a cfg line: "profileCfg 2", or "cfarCfg -1 1".
std::string shown(std::string setting) {
  const std::size_t at = setting.find('/');
  if (at == setting.npos) return setting;
  return setting.replace(at, 1, setting.starts_with("cfar") ? " -1 " : " ");
}

}  // namespace

// Rejects encodings and line endings that an editor may have introduced by mistake.
void require_plain_text(std::string_view text, const std::string& name) {
  const auto fail = [&](const std::string& what) {
    throw Error(ExitCode::config, printable(name + ":" + what));
  };
  if (text.size() > max_cfg_bytes)
    fail(" has " + std::to_string(text.size()) + " bytes; expected a cfg of at most " +
         std::to_string(max_cfg_bytes));
  for (std::size_t at = 0; (at = text.find('\r', at)) != text.npos; ++at)
    if (at + 1 < text.size() && text[at + 1] != '\n' && text[at + 1] != '\r')
      fail(std::to_string(1 + std::ranges::count(text.substr(0, at), '\n')) +
           ": has a carriage return without a line feed; expected lines that end in LF or CR LF");
}

std::vector<CfgLine> command_lines(std::string_view cfg_text) {
  std::vector<CfgLine> lines;
  int number = 0;
  if (cfg_text.starts_with("\xef\xbb\xbf")) cfg_text.remove_prefix(3);
  while (!cfg_text.empty()) {
    const std::size_t end = std::min(cfg_text.find('\n'), cfg_text.size());
    std::string text(cfg_text.substr(0, end));
    cfg_text.remove_prefix(std::min(end + 1, cfg_text.size()));
    ++number;
    std::erase(text, '\r');
    const std::size_t first = text.find_first_not_of(" \t");
    if (first != text.npos && text[first] != '%') lines.push_back({number, std::move(text)});
  }
  return lines;
}

Cfg::Cfg(const std::vector<CfgLine>& lines, std::string name, RadarProfile& profile)
    : name_(std::move(name)), profile_(profile) {
  for (const CfgLine& line : lines) attempt([&] { add(line); });
  for (const auto& [command, lines_of] : commands_)
    if (const auto demo = other_demo_of(command); !demo.empty())
      fail(lines_of.front(), "is a command of " + std::string(demo) +
                                 "; expected a cfg of the out-of-box demo of SDK 3.4 to 3.6 for "
                                 "xWR68xx or xWR64xx, as in config/radar");
}

void Cfg::stop_if_faulty() const {
  if (faulty_) echofuse::refuse(profile_.refusals);
}

void Cfg::refuse(const std::string& line) const {
  if (profile_.refusals.size() <= max_faults && std::ranges::count(profile_.refusals, line) == 0)
    profile_.refusals.push_back(line);
}

std::string Cfg::complaint(const CfgCommand& c, const std::string& what) const {
  return printable(where(c.line) + std::string(c.words.empty() ? "" : c.words[0]) + " " + what);
}

void Cfg::fail(const CfgCommand& c, const std::string& what) const {
  throw Error(ExitCode::config, complaint(c, what));
}

const std::vector<CfgCommand>& Cfg::all(const std::string& command) const {
  const auto it = commands_.find(command);
  if (it == commands_.end()) throw Error(ExitCode::config, name_ + ": has no " + command);
  return it->second;
}

const CfgCommand* Cfg::of_subframe(const std::string& command, unsigned subframe) const {
  const CfgCommand* found = nullptr;
  if (has(command))
    for (const CfgCommand& c : all(command))
      if (applies_to(c, subframe)) found = &c;
  return found;
}

void Cfg::require(const std::string& command) {
  if (has(command)) return;
  faulty_ = true;
  if (missing_.insert(command).second) refuse(name_ + ": has no " + command);
}

double Cfg::number(const CfgCommand& c, std::size_t i) const {
  const DemoCommand* command = demo_command(c.words[0]);
  if (i >= c.words.size()) fail(c, miscounted(c, command ? command->numbers.size() : i));
  if (const auto value = to_number(c.words[i])) return *value;
  fail(c, quoted(c.words[i]) + " is not a number");
}

std::string Cfg::outside(const CfgCommand& c, std::size_t i) const {
  const DemoCommand* command = demo_command(c.words[0]);
  if (!command || i > command->numbers.size()) return {};
  const NumberRange& range = command->numbers[i - 1];
  const double value = number(c, i), min = range.from_previous ? number(c, i - 1) : range.min;
  const bool fits = min <= value && value <= range.max;
  // The firmware reads whole numbers with atoi, which ends at the first other character.
  const bool plain = range.hex || c.words[i].find_first_of(range.whole ? "xeE" : "x") == npos;
  const bool whole = !range.whole || value == std::floor(value);
  if (fits && plain && whole &&
      (!range.power_of_two || std::has_single_bit(static_cast<unsigned>(value))))
    return {};
  return quoted(c.words[i]) + " should be a " +
         (range.power_of_two ? "power of two"
          : range.whole      ? "whole number"
                             : "number") +
         " from " + digits(min, 1e-4) + " to " + digits(range.max, 1e-4);
}

double Cfg::checked(const CfgCommand& c, std::size_t i) const {
  if (const std::string what = outside(c, i); !what.empty()) fail(c, what);
  return number(c, i);
}

// Splits the line into words and stores the command. The firmware splits words only at spaces.
// Other separators are reported and then treated as spaces.
void Cfg::add(const CfgLine& line) {
  CfgCommand c{line.number, {}};
  const std::string_view text = line.text;
  const auto plain = [](char byte) { return byte > ' ' && byte <= '~'; };
  for (auto at = text.begin(); (at = std::find_if(at, text.end(), plain)) != text.end();) {
    const auto end = std::find_if_not(at, text.end(), plain);
    c.words.push_back(text.substr(static_cast<std::size_t>(at - text.begin()),
                                  static_cast<std::size_t>(end - at)));
    at = end;
  }
  const auto odd = std::ranges::find_if(text, [&](char b) { return b != ' ' && !plain(b); });
  const std::string_view from = text.substr(static_cast<std::size_t>(odd - text.begin()));
  if (!from.empty())
    refuse(where(line.number) + "column " + std::to_string(odd - text.begin() + 1) + " has a " +
           (from[0] == '\t'                                            ? "tab"
            : from.starts_with("\xc2\xa0") || from.starts_with("\xa0") ? "no-break space"
            : static_cast<unsigned char>(from[0]) < 0x80               ? "control character"
                                                                       : "non-ASCII character") +
           "; the firmware splits words at spaces only");
  if (text.size() > max_line)
    fail(c, "line has " + std::to_string(text.size()) + " characters (limit of the firmware: 255)");
  if (c.words.size() > max_words) fail(c, "line has more than 40 words (limit of the firmware)");
  if (c.words.empty()) return;
  check_words(c);
  // Settings that follow sensorStart do not apply to the started frame.
  if (!has("sensorStart")) commands_[std::string(c.words[0])].push_back(c);
  if (c.words[0] == "sensorStart") check_start(c);
}

void Cfg::check_words(const CfgCommand& c) {
  const std::string name(c.words[0]);
  if (!std::isalpha(static_cast<unsigned char>(name[0])))
    return refuse(c, "is not a command; comments begin with %");
  if (name == "peakGrouping") return refuse(c, "is a command of SDK 1 or 2");
  const DemoCommand* command = demo_command(name);
  if (!command) return refuse(c, "is not a command of the demo of SDK 3.4 to 3.6");
  check_order(c, *command);
  const std::size_t expected = command->numbers.size();
  for (std::size_t i = 1; i < c.words.size(); ++i)
    if (!to_number(c.words[i]))
      return refuse(
          c, quoted(c.words[i]) + (i == expected + 1
                                       ? " follows the numbers; put comments on their own line"
                                       : " is not a number"));
  if (name == "sensorStart" && c.words.size() > 1)
    return refuse(c, "has an argument, which the firmware refuses after new settings");
  if (name == "sensorStop") {
    if (has("sensorStart")) refuse(c, "stops the radar that sensorStart started");
    return;
  }
  if (expected + 1 != c.words.size()) return refuse(c, miscounted(c, expected));
  for (std::size_t i = 1; i <= expected; ++i)
    if (const std::string what = outside(c, i); !what.empty()) refuse(c, what);
  check_combination(c);
}

// Checks arguments that the demo accepts only together.
void Cfg::check_combination(const CfgCommand& c) {
  constexpr double max_bins = 32;
  if (c.words[0] == "calibDcRangeSig" && number(c, 4) - number(c, 3) >= max_bins)
    refuse(c, "has more than 32 bins (limit of the demo)");
  if (c.words[0] == "calibData" && number(c, 1) != 0 && number(c, 2) != 0)
    refuse(c, "saves and restores at once; the demo does only one of both");
  if (c.words[0] == "lvdsStreamCfg" && number(c, 2) == 0 && number(c, 3) != 0 && number(c, 4) != 0)
    refuse(c, "streams samples and results without a header, which the demo requires");
}

// Checks that the settings required by the command precede it, as in the firmware.
void Cfg::check_order(const CfgCommand& c, const DemoCommand& command) {
  const std::string name(c.words[0]);
  for (std::string required : command.after) {
    if (required.ends_with('#') && c.words.size() > 3)
      required.replace(required.size() - 1, 1, c.words[3]);
    if (!settings_.contains(required) && missing_.insert(required).second)
      refuse(c, "requires " + shown(required) + " before it");
  }
  if (name == "flushCfg" || name == "dfeDataOutputMode")
    std::erase_if(settings_, [&](const std::string& setting) {
      const std::string_view of = command_of(setting);
      return name == "flushCfg" ? demo_command(of)->flushed : of == name;
    });
  if (has("sensorStart") && !command.needed.empty())
    profile_.warnings.push_back(complaint(c, "has no effect after sensorStart"));
  settings_.insert(name);
  std::string setting = name;
  if (command.key && command.key < c.words.size())
    settings_.insert(setting.append("/").append(c.words[command.key]));
  for (unsigned k = 0; command.per_subframe && k < max_subframes; ++k)
    if (applies_to(c, k)) settings_.insert(setting + "#" + std::to_string(k));
}

void Cfg::check_start(const CfgCommand& start) {
  std::string names;
  const unsigned subframes = advanced() && has("advFrameCfg") ? integer(last("advFrameCfg"), 1) : 1;
  for (const std::string& setting : needed_to_start(advanced() ? 3 : 1))
    for (unsigned k = 0; k < subframes; ++k) {
      std::string needed = setting, lacks = shown(setting);
      if (demo_command(command_of(setting))->per_subframe)
        needed.append("#").append(std::to_string(k));
      if (settings_.contains(needed) || !missing_.insert(setting).second) continue;
      if (settings_.contains(setting)) lacks.append(" for subframe ").append(std::to_string(k));
      names.append(names.empty() ? "" : ", ").append(lacks);
    }
  if (!names.empty()) refuse(start, "requires " + names + " before it");
}

}  // namespace echofuse::radar

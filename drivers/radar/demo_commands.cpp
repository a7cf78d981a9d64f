// SPDX-License-Identifier: MIT
#include "drivers/radar/demo_commands.hpp"

#include <bit>
#include <charconv>
#include <map>
#include <sstream>

namespace echofuse::radar {
namespace {

// Row of the table of commands. Ranges are written as
//   min:max  whole numbers      min^max  powers of two      =:max  whole, at least the previous one
//   min~max  all numbers        n*range  n times            =~max  at least the previous number
//   min#max  whole numbers, also hexadecimal                -1:3   as first: number of a subframe
// `after` lists commands that must come before; `/N` requires N as the value of the command's key
// and `/#` the command's third argument. `needed`: + once, 2 once for each value of the key, 0 and
// 1. `flushed`: * if flushCfg deletes the setting.
struct Row {
  const char *name, *numbers, *after = "", *needed = "", *flushed = "";
  std::size_t key = 0;
};

// Sources: SDK 3.4, mmw_cli.c and cli_mmwave.c (numbers and order), mmwdemo_rfparser.c (supported
// values), rl_sensor.h (limits of the front end); SDK user guide, configuration file format.
constexpr Row rows[] = {
    {"sensorStart", ""},
    {"sensorStop", ""},
    {"version", ""},
    {"queryDemoStatus", ""},
    {"configDataPort", "1:3125000 0:1"},
    {"flushCfg", ""},
    {"dfeDataOutputMode", "1:3", "", "+", "*", 1},
    {"channelCfg", "1:15 1:7 0:0", "", "+", "*"},
    {"adcCfg", "2:2 1:2", "", "+", "*"},
    {"adcbufCfg", "-1:3 0:0 1:1 1:1 1:1", "", "+"},
    {"lowPower", "0:1 0:1", "", "", "*"},
    {"profileCfg",
     "0:3 0~100 0~5242.87 0~40.95 0~5000 0:1973790 0:16579836 0.0363~250 -40.96~40.95 2:1024 "
     "2000:37500 0:3 0:3 24:180",
     "dfeDataOutputMode", "+", "*", 1},
    {"chirpCfg", "0:511 =:511 0:3 0~337500000 0~2281 0~40.95 0~40.95 0:7",
     "dfeDataOutputMode profileCfg/#", "+", "*"},
    {"frameCfg", "0:511 =:511 1:255 0:65535 0.3~1342 1:2 0~100", "dfeDataOutputMode/1", "+", "*"},
    {"advFrameCfg", "1:4 0:0 0:65535 1:2 0~100", "dfeDataOutputMode/3", "+", "*"},
    {"subFrameCfg", "0:3 0:3 0:511 1:512 1:255 0.05~1342 0:511 1:1 1:1 0.3~1342",
     "dfeDataOutputMode/3 advFrameCfg", "+", "*", 1},
    {"guiMonitor", "-1:3 0:2 5*0:1", "", "+"},
    {"cfarCfg", "-1:3 0:1 0:2 1:255 0:255 0:31 0:1 0~100 0:1", "", "2", "", 2},
    {"multiObjBeamForming", "-1:3 0:1 0~1", "", "+"},
    {"calibDcRangeSig", "-1:3 0:1 -31:0 0:31 1^32768", "", "+"},
    {"clutterRemoval", "-1:3 0:1", "", "+"},
    {"compRangeBiasAndRxChanPhase", "-100~100 24*-1~1", "", "+"},
    {"measureRangeBiasAndRxChanPhase", "0:1 0~100 0~100", "", "+"},
    {"aoaFovCfg", "-1:3 -90~90 =~90 -90~90 =~90", "", "+"},
    {"cfarFovCfg", "-1:3 0:1 -1000~1000 =~1000", "", "2", "", 2},
    {"extendedMaxVelocity", "-1:3 0:1", "", "+"},
    {"CQRxSatMonitor", "0:3 0:3 0:65535 0:127 0:15"},
    {"CQSigImgMonitor", "0:3 0:127 0:65535"},
    {"analogMonitor", "0:1 0:1", "", "+"},
    {"lvdsStreamCfg", "-1:3 0:1 0:4 0:1", "", "+"},
    {"bpmCfg", "-1:3 0:1 0:511 0:511"},
    {"bpmCfgAdvanced", "0:511 =:511 0:63", "dfeDataOutputMode"},
    {"calibData", "0:1 0:1 0#4294967295"},
};

double number(std::string_view text) {
  double value = 0;
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

std::vector<NumberRange> ranges(const char* text) {
  std::vector<NumberRange> out;
  std::istringstream in(text);
  for (std::string word; in >> word;) {
    const std::size_t times = word.find('*'), from = times == word.npos ? 0 : times + 1;
    const std::size_t sign = word.find_first_of(":~^#");
    const bool previous = word[from] == '=';
    out.insert(
        out.end(), times == word.npos ? 1 : static_cast<std::size_t>(number(word)),
        {previous ? 0 : number(word.substr(from, sign - from)), number(word.substr(sign + 1)),
         word[sign] != '~', word[sign] == '^', previous, word[sign] == '#'});
  }
  return out;
}

std::map<std::string_view, DemoCommand> read_rows() {
  std::map<std::string_view, DemoCommand> out;
  for (const Row& row : rows) {
    DemoCommand& c = out[row.name];
    c.numbers = ranges(row.numbers);
    c.key = row.key;
    c.flushed = *row.flushed;
    c.per_subframe = !c.numbers.empty() && c.numbers[0].min == -1;
    std::istringstream after(row.after);
    for (std::string word; after >> word;) c.after.push_back(word);
    if (*row.needed == '+') c.needed = {row.name};
    if (*row.needed == '2') c.needed = {std::string(row.name) + "/0", std::string(row.name) + "/1"};
  }
  return out;
}

const std::map<std::string_view, DemoCommand>& table() {
  static const auto commands = read_rows();
  return commands;
}

}  // namespace

const DemoCommand* demo_command(std::string_view name) {
  const auto it = table().find(name);
  return it == table().end() ? nullptr : &it->second;
}

std::vector<std::string> needed_to_start(unsigned mode) {
  std::vector<std::string> out;
  for (const Row& row : rows) {
    const DemoCommand& c = table().at(row.name);
    const std::string_view first = c.after.empty() ? "" : std::string_view(c.after.front());
    if (first.find('/') == first.npos || first.ends_with(std::to_string(mode)))
      out.insert(out.end(), c.needed.begin(), c.needed.end());
  }
  return out;
}

double frame_memory_bytes(unsigned bins, unsigned antennas, unsigned loops) {
  // radar cube: two i16 per sample; detection matrix: u16 (SDK 3.4, datapath/dpif)
  constexpr double complex_bytes = 4, magnitude_bytes = 2;
  return bins * (complex_bytes * antennas * loops + magnitude_bytes * std::bit_ceil(loops));
}

}  // namespace echofuse::radar

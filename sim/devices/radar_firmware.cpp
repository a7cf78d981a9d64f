// SPDX-License-Identifier: MIT
#include "sim/devices/radar_firmware.hpp"

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <iterator>
#include <sstream>
#include <utility>

namespace echofuse::sim {
namespace {

// limits of the demo's command line (SDK 3.4, utils/cli/src/cli.c)
constexpr std::size_t longest_read = 255, max_words = 40;
constexpr unsigned last_chirp = 511, max_subframes = 4, advanced = 3;
constexpr char banner_line[] = "******************************************\n";
constexpr char prompt_text[] = "mmwDemo:/>";

struct CommandRule {
  bool needed;        // the command is required before sensorStart
  bool when_started;  // the command is allowed while the sensor is running
  // The third word of the command selects one of two settings: 0 for range, 1 for Doppler.
  bool by_direction;
  // The front end or the parser of the demo checks the arguments at sensorStart.
  bool checked_at_start;
  // Minimum and maximum of each argument. Sources: rl_sensor.h and the user guide of the SDK.
  const char* limits;
};
const std::map<std::string, CommandRule> configuring = {
    {"flushCfg", {false, true, false, false, ""}},
    {"dfeDataOutputMode", {false, true, false, false, "1 3"}},
    {"channelCfg", {false, true, false, true, "1 15  1 7  0 0"}},
    {"adcCfg", {false, true, false, true, "2 2  1 2"}},
    {"adcbufCfg", {true, false, false, true, "-1 3  0 0  1 1  1 1  1 1"}},
    {"lowPower", {false, true, false, true, "0 1  0 1"}},
    {"profileCfg",
     {false, true, false, true,
      "0 3  0 100  0 5242.87  0 40.95  0 5000  0 1973790  0 16579836  0 250  -40.96 40.95  2 1024  "
      "2000 37500  0 3  0 3  24 180"}},
    {"chirpCfg",
     {false, true, false, true, "0 511  0 511  0 3  0 3.375e8  0 2281  0 40.95  0 40.95  0 7"}},
    {"frameCfg", {false, true, false, true, "0 511  0 511  1 255  0 65535  0.3 1342  1 2  0 100"}},
    {"advFrameCfg", {false, true, false, true, "1 4  0 0  0 65535  1 2  0 100"}},
    {"subFrameCfg",
     {false, true, false, true,
      "0 3  0 3  0 511  1 512  1 255  0.05 1342  0 511  1 1  1 1  0.3 1342"}},
    {"guiMonitor", {true, true, false, false, "-1 3  0 2  0 1  0 1  0 1  0 1  0 1"}},
    {"cfarCfg", {true, true, true, false, "-1 3  0 1  0 2  1 255  0 255  0 31  0 1  0 100  0 1"}},
    {"multiObjBeamForming", {true, true, false, false, "-1 3  0 1  0 1"}},
    {"calibDcRangeSig", {true, true, false, false, "-1 3  0 1  -31 0  0 31  1 32768"}},
    {"clutterRemoval", {true, true, false, false, "-1 3  0 1"}},
    {"compRangeBiasAndRxChanPhase",
     {true, true, false, false,
      "-100 100  -1 1 -1 1 -1 1 -1 1 -1 1 -1 1 -1 1 -1 1 -1 1 -1 1 -1 1 -1 1  "
      "-1 1 -1 1 -1 1 -1 1 -1 1 -1 1 -1 1 -1 1 -1 1 -1 1 -1 1 -1 1"}},
    {"measureRangeBiasAndRxChanPhase", {true, true, false, false, "0 1  0 100  0 100"}},
    {"aoaFovCfg", {true, true, false, false, "-1 3  -90 90  -90 90  -90 90  -90 90"}},
    {"cfarFovCfg", {true, true, true, false, "-1 3  0 1  -1000 1000  -1000 1000"}},
    {"extendedMaxVelocity", {true, true, false, false, "-1 3  0 1"}},
    {"CQRxSatMonitor", {false, false, false, false, "0 3  0 3  0 65535  0 127  0 15"}},
    {"CQSigImgMonitor", {false, false, false, false, "0 3  0 127  0 65535"}},
    {"analogMonitor", {true, false, false, false, "0 1  0 1"}},
    {"lvdsStreamCfg", {true, false, false, false, "-1 3  0 1  0 4  0 1"}},
    {"bpmCfg", {true, false, false, false, "-1 3  0 1  0 511  0 511"}},
    {"calibData", {true, true, false, false, "0 1  0 1  0 4294967295"}},
};
const char* const latched_commands[] = {"channelCfg", "adcCfg", "lowPower"};

constexpr char partial_configuration[] =
    "Error: You have provided partial configuration between stop and this command and partial "
    "configuration cannot be undone.Issue the full configuration and do \"sensorStart\" \n";

double number(const std::vector<std::string>& words, std::size_t i) {
  return i < words.size() ? std::atof(words[i].c_str()) : 0;
}
// Like atoi in the firmware, reads "2e3" as 2.
unsigned whole(const std::vector<std::string>& words, std::size_t i) {
  const long value = i < words.size() ? std::strtol(words[i].c_str(), nullptr, 10) : 0;
  return static_cast<unsigned>(std::clamp(value, 0L, 1'000'000'000L));
}

// Appends the transmitters in the mask that are not yet in the list.
void add_transmitters(unsigned mask, std::vector<unsigned>& transmitters) {
  for (unsigned t = 0; t < 3; ++t)
    if (mask >> t & 1 && std::count(transmitters.begin(), transmitters.end(), t) == 0)
      transmitters.push_back(t);
}

// Returns the limits of the command's arguments, minimum before maximum.
std::vector<double> limits_of(const std::string& command) {
  std::istringstream in(configuring.at(command).limits);
  return {std::istream_iterator<double>(in), {}};
}

// Returns true if each argument is within its limits and no pair of limits is reversed.
bool arguments_possible(const std::vector<std::string>& words) {
  const auto limits = limits_of(words[0]);
  for (std::size_t i = 0; i < limits.size() / 2; ++i)
    if (number(words, i + 1) < limits[2 * i] || number(words, i + 1) > limits[2 * i + 1])
      return false;
  const auto ordered = [&](std::size_t i) { return number(words, i) <= number(words, i + 1); };
  if (words[0] == "chirpCfg" || words[0] == "frameCfg") return ordered(1);
  return words[0] == "aoaFovCfg" ? ordered(2) && ordered(4)
                                 : words[0] != "cfarFovCfg" || ordered(3);
}

// Computes the frequency ramp of a chirp from its profileCfg and the offsets in its chirpCfg.
void set_ramp(const std::vector<std::string>& profile, const std::vector<std::string>& added,
              Chirp& chirp) {
  chirp.start_ghz = number(profile, 2) + 1e-9 * number(added, 4);
  chirp.idle_us = number(profile, 3) + number(added, 6);
  chirp.adc_start_us = number(profile, 4) + number(added, 7);
  chirp.ramp_end_us = number(profile, 5);
  chirp.slope_mhz_us = number(profile, 8) + 1e-3 * number(added, 5);
  chirp.samples = whole(profile, 10);
  chirp.sample_rate_ksps = whole(profile, 11);
}

// Splits a line at spaces. As in the firmware, a tab does not separate words.
std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> words;
  std::istringstream in(line.substr(0, line.find_last_not_of('\n') + 1));
  for (std::string word; words.size() < max_words && std::getline(in, word, ' ');)
    if (!word.empty()) words.push_back(word);
  return words;
}

}  // namespace

RadarFirmware::RadarFirmware(Write cli, Write data, unsigned sdk, RadarDemo demo)
    : cli_(std::move(cli)), data_(std::move(data)), sdk_(sdk), demo_(demo) {}

std::string RadarFirmware::version() const {
  return sdk_ == 4 ? "03.04.00.03" : sdk_ == 5 ? "03.05.00.04" : "03.06.00.00";
}

bool RadarFirmware::has_command(const std::string& command) const {
  return configuring.count(command) > 0 && (command != "calibData" || sdk_ >= 5) &&
         (command != "bpmCfg" || demo_ == RadarDemo::dsp);
}

void RadarFirmware::boot() {
  const std::string chip = demo_ == RadarDemo::dsp ? "xWR68xx" : "xWR64xx";
  say(banner_line + (chip + " MMW Demo " + version() + '\n') + banner_line);
  prompt();
}

// Sends a string. The UART driver of the firmware sends a carriage return after, not before, each
// line feed.
void RadarFirmware::say(const std::string& text) {
  std::string wire;
  for (const char c : text) {
    wire += c;
    if (c == '\n') wire += '\r';
  }
  cli_(wire);
}

void RadarFirmware::prompt() { cli_(prompt_text); }

void RadarFirmware::receive(ByteView bytes) {
  for (const std::uint8_t byte : bytes) {
    if (stopping_ || dead_) return;
    // The firmware echoes a carriage return, converts it to a line feed, and echoes the line feed
    // too.
    if (byte == '\r') cli_("\r");
    const char c = byte == '\r' ? '\n' : static_cast<char>(byte);
    cli_(std::string(1, c));
    line_ += c;
    if (c == '\n' || line_.size() == longest_read) run_line();
  }
}

void RadarFirmware::run_line() {
  const std::string line = std::exchange(line_, {});
  if (!line.empty() && line[0] == '%') {
    say("Skipped\n");
    return prompt();
  }
  const CommandWords words = split(line);
  if (words.empty()) return prompt();
  if (const auto status = execute(words)) answer(*status);
}

void RadarFirmware::answer(int status) {
  say(status == 0 ? "Done\n" : "Error " + std::to_string(status) + "\n");
  prompt();
}

std::optional<int> RadarFirmware::execute(const CommandWords& words) {
  const std::string& name = words[0];
  if (name == "sensorStart") return sensor_start(words);
  if (name == "sensorStop") return sensor_stop();
  if (name == "configDataPort") return config_data_port(words);
  if (name == "version") return print_version();
  if (name == "queryDemoStatus") return print_status();
  if (!has_command(name)) {
    say("'" + name + "' is not recognized as a CLI command\n");
    prompt();
    return {};
  }
  const CommandRule& command = configuring.at(name);
  if (!command.when_started && state_ == DemoState::started) {
    say("Ignored: This command is not allowed after sensor has started\n");
    return 0;
  }
  if (words.size() != 1 + limits_of(name).size() / 2) {
    say("Error: Invalid usage of the CLI command\n");
    return -1;
  }
  if (!command.checked_at_start && !arguments_possible(words)) {
    say("Error: Invalid argument\n");
    return -1;
  }
  const std::string key = command.by_direction ? name + " " + words[2] : name;
  const int status = configure(words, key);
  // A first argument of -1 to 3 selects the subframes.
  const bool all = limits_of(name).empty() || limits_of(name)[0] != -1 || number(words, 1) == -1;
  for (unsigned k = 0; status == 0 && command.needed && k < max_subframes; ++k)
    if (all || whole(words, 1) == k) pending_.insert(key + "@" + std::to_string(k));
  return status;
}

int RadarFirmware::configure(const CommandWords& words, const std::string& key) {
  const std::string& name = words[0];
  if (name == "adcbufCfg" && whole(words, 5) != 1) {
    say("Error: chirpThreshold must be 1, multi-chirp is not allowed\n");
    return -1;
  }
  const unsigned mode = whole(config_["dfeDataOutputMode"], 1);
  if ((name == "frameCfg" && mode != 1) || (name.ends_with("FrameCfg") && mode != 3) ||
      ((name == "profileCfg" || name == "chirpCfg") && mode != 1 && mode != 3)) {
    say("Error: Configuration is not valid for the DFE Output Mode\n");
    return -1;
  }
  if (name == "subFrameCfg" && whole(words, 1) >= whole(config_["advFrameCfg"], 1)) {
    say("Error: Invalid subframe number.\n");
    return -1;
  }
  if (name == "calibDcRangeSig" &&
      (!std::has_single_bit(whole(words, 5)) || number(words, 4) - number(words, 3) + 1 > 32)) {
    say("Error: Number of bins exceeds the limit or number of averaged chirps is not power of "
        "two\n");
    return -1;
  }
  if ((name == "calibData" && whole(words, 1) == 1 && whole(words, 2) == 1) ||
      (name == "lvdsStreamCfg" && whole(words, 2) == 0 && whole(words, 3) * whole(words, 4) > 0)) {
    say("Error: arguments that exclude each other\n");
    return -1;
  }
  if (name == "flushCfg") {
    chirps_.clear(), profiles_.clear(), subframe_cfgs_.clear();
    for (const char* part : {"frameCfg", "advFrameCfg", "dfeDataOutputMode"}) config_.erase(part);
    for (const char* part : latched_commands) config_.erase(part);
  }
  if (name == "chirpCfg" && !profiles_.contains(whole(words, 3))) return -1;
  if (name == "chirpCfg") chirps_.push_back(words);
  if (name == "profileCfg") profiles_[whole(words, 1)] = words;
  if (name == "subFrameCfg") subframe_cfgs_[whole(words, 1)] = words;
  config_[key] = words;
  return name == "guiMonitor" ? gui_monitor(words) : 0;
}

int RadarFirmware::gui_monitor(const CommandWords& words) {
  if (whole(words, 4) != 0 || whole(words, 6) != 0)
    say("Ignored: noise profile and Doppler heat map are not simulated\n");
  return 0;
}

int RadarFirmware::config_data_port(const CommandWords& words) {
  constexpr unsigned fastest = 3125000;  // highest baud rate of the data port (SDK 3.4)
  if (state_ == DemoState::started) {
    say("Ignored: This command is not allowed after sensor has started\n");
    return 0;
  }
  const unsigned baud = whole(words, 1);
  if (baud > fastest) {
    say("Ignored: Invalid baud rate (" + std::to_string(baud) + ") specified\n");
    return 0;
  }
  if (baud != data_baud_) say("Data port baud rate changed to " + std::to_string(baud) + "\n");
  data_baud_ = baud;
  if (whole(words, 2) != 0) data_(std::string(16, '\xff'));
  return 0;
}

int RadarFirmware::print_version() {
  say("Platform                : xWR68xx\n"
      "mmWave SDK Version      : " +
      version() +
      "\n"
      "Device Info             : IWR68XX ES 02.00\n"
      "RF F/W Version          : 06.03.02.06.20.08.11\n"
      "mmWaveLink Version      : 01.02.06.06\n");
  return 0;
}

int RadarFirmware::print_status() {
  say("Sensor State: " + std::to_string(static_cast<int>(state_)) + "\n");
  say("Data port baud rate: " + std::to_string(data_baud_) + "\n");
  return 0;
}

unsigned RadarFirmware::subframe_count() {
  const bool several = whole(config_["dfeDataOutputMode"], 1) == advanced;
  return several ? std::min(whole(config_["advFrameCfg"], 1), max_subframes) : 1;
}

bool RadarFirmware::all_pending() {
  const unsigned count = subframe_count();
  const auto pending = [&](const std::string& key) {
    for (unsigned k = 0; k < count; ++k)
      if (pending_.count(key + "@" + std::to_string(k)) == 0) return false;
    return true;
  };
  return std::all_of(configuring.begin(), configuring.end(), [&](const auto& entry) {
    if (!entry.second.needed || !has_command(entry.first)) return true;
    if (!entry.second.by_direction) return pending(entry.first);
    return pending(entry.first + " 0") && pending(entry.first + " 1");
  });
}

// Prints an error and returns true if sensorStart does not match the configuration. If sensorStart
// has no argument, it requires a complete new configuration. "sensorStart 0" requires that nothing
// has been configured since the last start.
bool RadarFirmware::refuse_start(bool reconfigure) {
  const bool first = state_ == DemoState::init || state_ == DemoState::opened;
  if (reconfigure && all_pending()) return false;
  if (!reconfigure && !first && pending_.empty()) return false;
  if (first)
    say("Error: Full configuration must be provided before sensor can be started the first time\n");
  else if (reconfigure && pending_.empty())
    say("Error: You have provided no configuration, issue \"sensorStart 0\" OR provide full "
        "configuration and issue \"sensorStart\"\n");
  else if (!reconfigure && all_pending())
    say("Error: You have provided complete new configuration, issue \"sensorStart\" (without "
        "argument) if you want it to take effect\n");
  else
    say(partial_configuration);
  return true;
}

// The antennas, the ADC and the power mode are configured only at the first start. If they are
// changed later, prints the failed assertion of the demo and returns true; the command line then
// hangs, as on the board.
bool RadarFirmware::changed_latched() {
  for (const char* name : latched_commands) {
    if (state_ == DemoState::init) latched_[name] = config_[name];
    if (config_[name] == latched_[name]) continue;
    say("Exception: mmw_cli.c, line 263.\n");
    dead_ = true;
    return true;
  }
  return false;
}

std::optional<int> RadarFirmware::sensor_start(const CommandWords& words) {
  const bool reconfigure = words.size() != 2;
  if (!reconfigure && whole(words, 1) != 0) {
    say("Error: Reconfig is not supported, only argument of 0 is\n"
        "(do not reconfig, just re-start the sensor) valid\n");
    return -1;
  }
  if (state_ == DemoState::started) {
    say("Ignored: Sensor is already started\n");
    return 0;
  }
  if (refuse_start(reconfigure)) return -1;
  if (changed_latched()) return {};
  const auto configured = subframes_configured();
  if (state_ == DemoState::init) state_ = DemoState::opened;
  if (configured.empty()) return -1;
  pending_.clear();
  const CommandWords& gui = config_["guiMonitor"];
  const CommandWords& bias = config_["measureRangeBiasAndRxChanPhase"];
  outputs_ = {whole(gui, 2) != 0,  whole(gui, 3) != 0, whole(gui, 5) != 0, whole(gui, 7) != 0,
              whole(bias, 1) != 0, number(bias, 2),    number(bias, 3)};
  subframes_ = configured;
  running_ = configured.front();
  state_ = DemoState::started;
  return 0;
}

std::optional<int> RadarFirmware::sensor_stop() {
  if (state_ != DemoState::started) {
    say("Ignored: Sensor is already stopped\n");
    return 0;
  }
  stopping_ = true;
  return {};
}

void RadarFirmware::between_frames() {
  if (!stopping_) return;
  stopping_ = false;
  running_.reset();
  state_ = DemoState::stopped;
  answer(0);
}

// Returns the chirp of each subframe, or a single chirp if there are no subframes. Returns an empty
// list if a command is missing or the front end would reject the frame. Subframes may differ only
// in their start frequency, because other differences are not simulated.
std::vector<Chirp> RadarFirmware::subframes_configured() {
  for (const char* latched : {"channelCfg", "adcCfg"})
    if (config_[latched].empty()) return {};
  std::vector<CommandWords> checked = chirps_;
  for (const auto* settings : {&profiles_, &subframe_cfgs_})
    for (const auto& [number, words] : *settings) checked.push_back(words);
  for (const auto& [name, words] : config_)
    if (!words.empty() && configuring.at(words[0]).checked_at_start) checked.push_back(words);
  if (!std::all_of(checked.begin(), checked.end(), arguments_possible)) return {};
  if (whole(config_["dfeDataOutputMode"], 1) != advanced) {
    const CommandWords& f = config_["frameCfg"];
    const auto one = chirp({whole(f, 1), whole(f, 2), whole(f, 3), whole(f, 4), number(f, 5)});
    return one ? std::vector{*one} : std::vector<Chirp>{};
  }
  std::vector<Chirp> out;
  const CommandWords& frame = config_["advFrameCfg"];
  for (unsigned k = 0; k < subframe_count(); ++k) {
    const CommandWords& s = subframe_cfgs_[k];
    const unsigned first = whole(s, 3);
    const auto one = chirp({first, first + std::max(1u, whole(s, 4)) - 1, whole(s, 5),
                            whole(frame, 3), number(s, 10)});
    if (!one) return {};
    Chirp like_first = *one;
    if (!out.empty()) like_first.start_ghz = out.front().start_ghz;
    if (!out.empty() && like_first != out.front()) {
      say("Error: subframes with different chirps are not simulated\n");
      return {};
    }
    out.push_back(*one);
  }
  return out;
}

// Returns true if the front end accepts the ramp of each profile, and of each chirp with its
// offsets.
bool RadarFirmware::ramps_possible() {
  Chirp ramp;
  const auto refused = [&](const CommandWords& profile, const CommandWords& added) {
    set_ramp(profile, added, ramp);
    return !ramp.ramp_possible() ||
           ramp.sample_rate_ksps > 12500 * whole(config_["adcCfg"], 2);  // complex 1x or 2x
  };
  return std::none_of(profiles_.begin(), profiles_.end(),
                      [&](const auto& profile) { return refused(profile.second, {}); }) &&
         std::none_of(chirps_.begin(), chirps_.end(), [&](const CommandWords& chirp) {
           return refused(profiles_[whole(chirp, 3)], chirp);
         });
}

// Returns the parameters of a frame. Returns an empty value if the front end or the parser of the
// demo would reject the frame. The parser ignores commands with chirps outside the frame. It
// requires one profile and, without BPM, one enabled transmitter for each chirp.
std::optional<Chirp> RadarFirmware::chirp(const FramePart& frame) {
  const CommandWords channel = config_["channelCfg"];
  const bool bpm = whole(config_["bpmCfg"], 2) != 0;
  std::set<unsigned> used_profiles;
  Chirp chirp;
  unsigned chirps = 0;
  for (unsigned i = frame.first; i <= std::min(frame.last, last_chirp); ++i) {
    const auto c = std::find_if(chirps_.rbegin(), chirps_.rend(), [&](const CommandWords& words) {
      return whole(words, 1) <= i && i <= whole(words, 2) && whole(words, 1) >= frame.first &&
             whole(words, 2) <= frame.last;
    });
    if (c == chirps_.rend()) return {};
    const unsigned enabled = whole(*c, 8) & whole(channel, 2);
    if (enabled == 0 || (!bpm && !std::has_single_bit(enabled))) return {};
    used_profiles.insert(whole(*c, 3));
    add_transmitters(enabled, chirp.transmitters);
    ++chirps;
  }
  if (used_profiles.size() != 1) return {};
  set_ramp(profiles_[*used_profiles.begin()], {}, chirp);
  chirp.receivers = whole(channel, 1) & 0xf;
  chirp.antennas = static_cast<unsigned>(static_cast<std::size_t>(std::popcount(chirp.receivers)) *
                                         chirp.transmitters.size());
  chirp.chirps_per_frame = chirps * frame.loops;
  chirp.frames = frame.frames;
  chirp.frame_period_ms = frame.period_ms;
  if (!ramps_possible() || !chirp.possible()) return {};
  // The parser of the demo has space for 32 chirps. The data path reserves memory for the radar
  // cube and the detection matrix.
  constexpr unsigned max_chirps = 32, memory = 0xC0000;
  const unsigned doppler_chirps =
      chirp.chirps_per_frame / static_cast<unsigned>(chirp.transmitters.size());
  const std::size_t cube = 4ul * chirp.antennas * doppler_chirps,
                    matrix = 2ul * std::bit_ceil(doppler_chirps);
  if (chirps > max_chirps || chirp.axis({}).count * (cube + matrix) > memory) return {};
  return chirp;
}

}  // namespace echofuse::sim

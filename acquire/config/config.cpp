// SPDX-License-Identifier: MIT
#include "acquire/config/config.hpp"

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <initializer_list>
#include <limits>
#include <map>
#include <sstream>
#include <utility>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/program.hpp"
#include "drivers/util/settings.hpp"

namespace echofuse::acquire {
namespace {

// Values that `Config` stores in another form.
struct Keys {
  std::string folder, cfg, calibration;
  bool first_photon_only = false;
};

void bind_policy(Settings& s, Config& c, const std::string& section, Sensor sensor) {
  s.add(section + ".policy", c.policy[sensor],
        "whether the device is optional or required; required: a run starts only if the device "
        "answers, and records without its data are marked incomplete",
        {"optional", "required"});
}

void bind_run(Settings& s, Config& c, Keys& k) {
  s.add("run.window_s", c.window_s, 0.05, 3600,
        "length of a time slot, s; one record is stored for each slot");
  s.add("run.connect_timeout_s", c.connect_timeout_s, 0.1, 3600,
        "maximum time to wait for the devices, s; after this time, the run starts with the devices "
        "that have answered");
  s.add("run.label", c.label, "label of every record, e.g. the scene in front of the sensors");
  s.add("run.operator", c.operator_name,
        "name of the operator, stored in the run; empty: the login name");
  s.add("run.folder", k.folder,
        "folder for runs that are recorded without --out (named DATE-NNN); relative to the folder "
        "of this configuration file; empty: the working directory");
  s.add("run.calibration", k.calibration,
        "calibration file that `calibrate` writes; its values are stored in each run and applied "
        "by the readers of the run; relative to the folder of this configuration file");
}

void bind_tdc(Settings& s, Config& c, Keys& k) {
  constexpr std::int64_t channel_max = std::numeric_limits<std::int32_t>::max();
  s.add("tdc.address", c.tdc.address,
        "address of the detector, one of: bridge:tcp://HOST:PORT, usb:VVVV:PPPP[:serial]; empty: "
        "no detector");
  bind_policy(s, c, "tdc", Sensor::spd);
  s.add("tdc.start_channel", c.histogram.start_channel, -channel_max, channel_max,
        "channel of the laser sync; negative for falling edges");
  s.add("tdc.click_channel", c.histogram.click_channel, -channel_max, channel_max,
        "channel of the detector; negative for falling edges");
  s.add("tdc.laser_rate_hz", c.laser_rate_hz, 0, 1e10,
        "number of laser pulses per second; a record with too few laser pulses is flagged "
        "\"lossy\"; 0: unknown");
  s.add("tdc.bin_width_ps", c.histogram.bin_width_ps, 1, 1'000'000'000,
        "width of a histogram bin in two-way time, ps");
  s.add("tdc.first_bin_ps", c.histogram.first_bin_ps, -1'000'000'000'000, 1'000'000'000'000,
        "two-way time from the laser sync to the start of bin 0, ps");
  s.add("tdc.bins", c.histogram.bins, 1, 1 << 24, "number of bins of the histogram");
  constexpr std::int64_t delay_max = 1'000'000'000;
  s.add(
      "tdc.click_delay_ps", c.histogram.click_delay_ps, -delay_max, delay_max,
      "delay added to the click times, ps; for time taggers that cannot add this delay themselves");
  s.add("tdc.dead_time_ps", c.histogram.dead_time_ps, 0, delay_max,
        "dead time of each channel, ps: a tag that follows another tag of its channel within this "
        "time is removed; 0: no tag is removed");
  s.add("tdc.detector_dead_time_ps", c.detector.dead_time_ps, 0, 1e9,
        "dead time of the detector after a click, from its data sheet, ps; 0: unknown; pile-up is "
        "then not corrected");
  s.add("tdc.first_photon_only", k.first_photon_only,
        "true: the detector is armed once per laser pulse, and detects only the first photon of "
        "the pulse");
}

void bind_radar(Settings& s, Config& c, Keys& k) {
  s.add("radar.address", c.radar.address,
        "address of a radar with a bridge, bridge:tcp://HOST:PORT, used instead of radar.cli, "
        "radar.data and radar.cfg; empty: no bridge");
  s.add("radar.cli", c.radar.cli,
        "command port of the radar, one of: serial:/dev/..., hid:VVVV:PPPP[:serial]; empty: no "
        "radar on these ports");
  bind_policy(s, c, "radar", Sensor::radar);
  s.add("radar.data", c.radar.data,
        "data port of the radar, one of: serial:/dev/..., hid:VVVV:PPPP[:serial]");
  s.add("radar.cfg", k.cfg,
        "TI mmWave .cfg file that is sent to the radar unchanged: name of an installed .cfg file, "
        "or path relative to the folder of this configuration file");
  s.add("radar.board", c.radar.board,
        "type of the radar board, which determines the antenna positions for the heat map",
        radar::board_names());
  s.add("radar.baseline_m", c.baseline_m, 0, max_baseline_m,
        "distance from the axis of the detector to the centre of the radar antennas, m; the radar "
        "is to the left of the detector");
  s.add("radar.mount_tolerance_m", c.mount_tolerance_m, 0, record::max_mount_tolerance_m,
        "standard deviation of the range error caused by movements of the mounts since the "
        "calibration, m");
  s.add("radar.data_baud", c.radar.data_baud, 1200, 4'000'000,
        "baud rate of the radar's data port");
  s.add("radar.keep_running", c.radar.keep_running,
        "true: do not send sensorStop at the end of a run, so that the radar keeps transmitting");
}

void bind_depth(Settings& s, Config& c) {
  s.add("depth.address", c.depth.address,
        "address of the depth camera, one of: openni:[URI or file.oni], bridge:tcp://HOST:PORT; "
        "empty: no camera");
  bind_policy(s, c, "depth", Sensor::depth);
  s.add("depth.width", c.depth.width, 0, 1 << 14,
        "image width of an OpenNI2 camera, pixels; 0: default of the camera");
  s.add("depth.height", c.depth.height, 0, 1 << 14,
        "image height of an OpenNI2 camera, pixels; 0: default of the camera");
  s.add("depth.fps", c.depth.fps, 0, 1000,
        "number of frames per second of an OpenNI2 camera; 0: default of the camera");
  s.add("depth.map_size", c.map.size, record::min_map_size, record::max_map_size,
        "number of pixels per side of the depth map; camera images are resampled to this size");
  s.add("depth.map_half_tangent", c.map.half_tangent, record::min_map_half_tangent,
        record::max_map_half_tangent,
        "field of view of the depth map, given as x/z and y/z at its edges");
  s.add("depth.map_z_max_m", c.map.far_m, record::min_map_far_m, record::max_map_far_m,
        "largest depth in the depth map, m; points that are farther away are marked \"no return\"");
}

void bind(Settings& s, Config& c, Keys& k) {
  bind_run(s, c, k);
  bind_tdc(s, c, k);
  bind_radar(s, c, k);
  bind_depth(s, c);
  bind_limits(s, c.signal);
  s.add("alert.after_s", c.alert.after_s, 0, 86'400,
        "time that a problem of a sensor must last before an alert, and the good state before its "
        "end is reported, s; 0: two slots");
  s.add("alert.disk_free_gb", c.alert.disk_free_gb, 0, 1e6,
        "alert if the disk of the run has less free space than this, GB; 0 disables this alert");
  s.add("alert.on_doubt", c.on_doubt,
        "program and its arguments, started by `run` when the state of a sensor or of the disk "
        "changes; a program in the folder of this configuration file needs no path; empty: no "
        "program");
}

// Collects the errors that the type and range checks of single keys cannot find.
class ConfigChecker {
 public:
  ConfigChecker(const Settings& settings, std::string name, std::vector<std::string>& faults)
      : settings_(settings), name_(std::move(name)), faults_(faults) {}

  // Reports an error with the origin of the first key in `keys` that has been set.
  void complain(std::initializer_list<const char*> keys, const std::string& what) {
    for (const char* key : keys)
      if (settings_.refused(key)) return;  // an error for this key has already been reported
    for (const char* key : keys) {
      const std::string origin = settings_.origin(key);
      if (origin.empty()) continue;
      const bool names_key = origin.starts_with("--set ");
      return faults_.push_back(origin + ": " + (names_key ? "" : key + std::string(": ")) + what);
    }
    faults_.push_back(name_ + ": " + what);
  }
  template <class Body>
  void attempt(std::initializer_list<const char*> keys, Body body) {
    try {
      body();
    } catch (const Error& e) {  // each line of the message describes one error
      std::istringstream lines(e.what());
      for (std::string line; std::getline(lines, line);) complain(keys, line);
    }
  }

 private:
  const Settings& settings_;
  std::string name_;
  std::vector<std::string>& faults_;
};

void check_radar_keys(ConfigChecker& checker, Config& c, const std::string& cfg,
                      const std::filesystem::path& folder) {
  RadarConfig& radar = c.radar;
  if (!radar.address.empty()) {
    if (!radar.cli.empty() || !radar.data.empty())
      checker.complain({"radar.address"},
                       "radar.address cannot be combined with radar.cli and radar.data; remove the "
                       "address or the two ports");
    return checker.attempt({"radar.address"}, [&] { check_radar(radar.address); });
  }
  if (radar.cli.empty() != radar.data.empty())
    checker.complain({"radar.cli", "radar.data"},
                     "one of radar.cli and radar.data is empty; set both ports");
  if (!radar.cli.empty())
    checker.attempt({"radar.cli"}, [&] { check_radar_port(radar.cli, RadarConfig::cli_baud); });
  if (!radar.data.empty())
    checker.attempt({"radar.data"}, [&] { check_radar_port(radar.data, radar.data_baud); });
  if (radar.cli.empty()) return;
  if (cfg.empty())
    return checker.complain({"radar.cfg", "radar.cli"},
                            "radar.cfg is empty; expected a TI mmWave .cfg file");
  checker.attempt({"radar.cfg"}, [&] {
    const auto path = here_or_installed(cfg, folder);
    radar.cfg_name = path.string();
    radar.cfg_text = read_config_text(path);
    const radar::RadarProfile profile = parse_profile(radar);
    for (const auto& place : profile.array)
      c.antennas.push_back({.x = static_cast<double>(place.x), .y = static_cast<double>(place.y)});
    for (const auto& refusal : profile.refusals) checker.complain({"radar.cfg"}, refusal);
  });
}

// Applies the antenna gains of the calibration file. Throws if the file and the heat map differ in
// their number of antennas.
void calibrate_antennas(Config& c) {
  const AntennaGains& gains = c.calibration.antennas;
  if (gains.empty() || c.antennas.empty()) return;
  if (gains.gain.size() != c.antennas.size())
    throw Error(ExitCode::config,
                c.calibration_path + ": contains gains for " + std::to_string(gains.gain.size()) +
                    " antennas, but the heat map of radar.cfg and radar.board has " +
                    std::to_string(c.antennas.size()) + "; calibrate again");
  for (std::size_t m = 0; m < c.antennas.size(); ++m) {
    c.antennas[m].gain = gains.gain[m];
    c.antennas[m].phase_rad = gains.phase_rad[m];
  }
}

// Throws if `radar.baseline_m` has changed since the calibration, because the radar offset depends
// on the baseline.
void refuse_other_baseline(const Config& c) {
  constexpr double allowed_m = 5e-3;
  const double measured_m = c.calibration.baseline_m;
  if (!c.configured().contains(Sensor::radar) || measured_m <= 0 ||
      std::abs(measured_m - c.baseline_m) <= allowed_m)
    return;
  std::ostringstream text;
  text << c.calibration_path << ": the radar was calibrated with radar.baseline_m = " << measured_m
       << ", but the configuration has " << c.baseline_m << "; calibrate again";
  throw Error(ExitCode::config, text.str());
}

void refuse_response_in_other_unit(const Config& c) {
  const auto fault = record::fault_of_width(c.calibration.response.meta(),
                                            static_cast<double>(c.histogram.bin_width_ps));
  if (!fault.empty()) throw Error(ExitCode::config, c.calibration_path + ": " + fault);
}

void check_config(ConfigChecker checker, Config& c, const Keys& k,
                  const std::filesystem::path& folder, bool with_calibration) {
  if (c.configured().empty())
    checker.complain(
        {"tdc.address", "radar.cli", "radar.address", "depth.address"},
        "no device is configured; expected at least one of tdc.address, radar.cli, radar.address, "
        "depth.address");
  struct PolicyKeys {
    const char *policy, *address;
  };
  constexpr PerSensor<PolicyKeys> keys{PolicyKeys{"tdc.policy", "tdc.address"},
                                       {"radar.policy", "radar.cli"},
                                       {"depth.policy", "depth.address"}};
  for (const Sensor s : all_sensors)
    if ((c.required() - c.configured()).contains(s))
      checker.complain({keys[s].policy},
                       std::string("the sensor is required, but ") + keys[s].address + " is empty");
  std::map<std::string, const char*> used;
  for (const auto& [key, address] : {std::pair{"tdc.address", &c.tdc.address},
                                     {"radar.cli", &c.radar.cli},
                                     {"radar.data", &c.radar.data},
                                     {"radar.address", &c.radar.address},
                                     {"depth.address", &c.depth.address}})
    if (const auto [other, is_new] = used.try_emplace(*address, key); !is_new && !address->empty())
      checker.complain({key, other->second}, std::string(other->second) + " and " + key +
                                                 " are the same port; expected different ports");
  if (!c.tdc.address.empty()) checker.attempt({"tdc.address"}, [&] { check_tdc(c.tdc.address); });
  checker.attempt({"tdc.click_channel", "tdc.start_channel", "tdc.bins", "tdc.bin_width_ps"},
                  [&] { const tdc::Histogram check(c.histogram); });
  check_radar_keys(checker, c, k.cfg, folder);
  // A program in the folder of the configuration precedes one of the same name in PATH.
  if (!c.on_doubt.empty())
    if (const auto own = folder / c.on_doubt[0];
        c.on_doubt[0].find('/') != std::string::npos || std::filesystem::is_regular_file(own))
      c.on_doubt[0] = std::filesystem::absolute(own).string();
  if (!k.folder.empty()) c.run_folder = (folder / k.folder).string();
  c.calibration_path =
      (folder / (k.calibration.empty() ? "calibration.toml" : k.calibration)).string();
  if (with_calibration && !k.calibration.empty())
    checker.attempt({"run.calibration"}, [&] {
      c.calibration = read_calibration(c.calibration_path);
      refuse_other_baseline(c);
      refuse_response_in_other_unit(c);
      calibrate_antennas(c);
    });
  if (!c.depth.address.empty())
    checker.attempt({"depth.address"}, [&] { check_depth(c.depth.address); });
}

std::string variable(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

}  // namespace

void bind_limits(Settings& s, SignalLimits& l) {
  s.add("signal.weak_share", l.weak_share, 0, 1,
        "flag a record \"weak\" if its signal is below this fraction of the median signal in the "
        "first minute of the run; 0 disables this flag");
  s.add("signal.spd_clicks", l.spd_clicks, 0, 1e12,
        "flag a record \"weak\" if it has fewer clicks above the background than this number; 0 "
        "disables this flag");
  s.add("signal.clicks_per_pulse", l.clicks_per_pulse, 0, 1e3,
        "flag a record \"saturated\" if it has more clicks per laser pulse than this number; 0 "
        "disables this flag");
  s.add("signal.radar_snr_db", l.radar_snr_db, 0, 200,
        "flag a record \"no peak\" if the ratio of peak to median of its range profile is below "
        "this, dB; 0 disables this flag");
  s.add("signal.depth_share", l.depth_share, 0, 1,
        "flag a record \"weak\" if the fraction of its pixels with a return is below this; 0 "
        "disables this flag");
  s.add("signal.lossy_share", l.lossy_share, 0, 1,
        "flag a record \"lossy\" if less than this fraction of the expected radar frames, camera "
        "frames or laser pulses arrives; 0 disables this flag");
}

radar::RadarProfile parse_profile(const RadarConfig& radar) {
  return radar::parse_profile(radar.cfg_text, radar.cfg_name, radar.data_baud,
                              radar::board_named(radar.board).value_or(radar::Board::isk));
}

SensorSet Config::configured() const {
  SensorSet set;
  if (!tdc.address.empty()) set.insert(Sensor::spd);
  if (!radar.cli.empty() || !radar.address.empty()) set.insert(Sensor::radar);
  if (!depth.address.empty()) set.insert(Sensor::depth);
  return set;
}

PerSensor<double> Config::nominal_hz() const {
  const bool has_cfg = !radar.cli.empty() && !radar.cfg_text.empty();
  return {laser_rate_hz, has_cfg ? 1 / parse_profile(radar).frame_period_s : 0.0,
          static_cast<double>(depth.fps)};
}

SensorSet Config::required() const {
  SensorSet set;
  for (const Sensor s : all_sensors)
    if (policy[s] == "required") set.insert(s);
  return set;
}

Config load_config(const std::string& path, const std::vector<std::string>& assignments,
                   bool with_calibration) {
  Config config;
  Keys keys;
  Settings settings;
  bind(settings, config, keys);
  config.text = read_config_text(path);
  std::vector<std::string> faults = settings.read(config.text, path, assignments);
  if (keys.first_photon_only)
    config.detector.dead_time_ps = std::numeric_limits<double>::infinity();
  if (settings.whole())
    check_config(ConfigChecker(settings, path, faults), config, keys,
                 std::filesystem::path(path).parent_path(), with_calibration);
  if (!faults.empty()) refuse(faults);
  ConfigChecker unfinished(settings, path, config.unfinished);
  for (const auto& [key, port] :
       {std::pair{"radar.cli", config.radar.cli}, {"radar.data", config.radar.data}})
    if (port.find("XXXXXXXX") != port.npos)
      unfinished.complain({key},
                          "still contains the template's XXXXXXXX; echofuse-acquire devices "
                          "prints the lines for the attached devices");
  if (!config.on_doubt.empty())
    if (const std::string fault = fault_of_program(config.on_doubt[0]); !fault.empty())
      unfinished.complain({"alert.on_doubt"}, fault);
  config.shown = settings.with_origins();
  const auto on_doubt = std::exchange(config.on_doubt, {});
  config.resolved = settings.resolved(true);
  config.on_doubt = on_doubt;
  return config;
}

std::vector<ConfigPlace> config_places() {
  if (const std::string named = variable("ECHOFUSE_CONFIG"); !named.empty())
    return {{named, "$ECHOFUSE_CONFIG"}};
  std::vector<ConfigPlace> places{{"lab.toml", "./lab.toml"}};
  const std::string own = variable("XDG_CONFIG_HOME"), home = variable("HOME");
  if (own.starts_with('/'))  // the XDG specification requires relative paths to be ignored
    places.push_back({own + "/echofuse/lab.toml", "$XDG_CONFIG_HOME/echofuse/lab.toml"});
  else if (!home.empty())
    places.push_back({home + "/.config/echofuse/lab.toml", "~/.config/echofuse/lab.toml"});
  places.push_back({"/etc/echofuse/lab.toml", "/etc/echofuse/lab.toml"});
  return places;
}

std::optional<ConfigPlace> find_config() {
  std::error_code none;
  const std::vector<ConfigPlace> places = config_places();
  const bool named = places.size() == 1;  // in the environment; the file may be missing
  for (const ConfigPlace& place : places)
    if (named || std::filesystem::exists(place.path, none)) return place;
  return std::nullopt;
}

ConfigPlace require_config() {
  if (const auto found = find_config()) return *found;
  std::string names;
  for (const ConfigPlace& place : config_places())
    names.append(names.empty() ? "" : ", ") += place.name;
  throw Error(ExitCode::config, "no configuration file found; searched " + names + "; copy " +
                                    (data_folder() / "lab.toml").string() +
                                    " there, or use --config or $ECHOFUSE_CONFIG");
}

}  // namespace echofuse::acquire

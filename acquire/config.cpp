// SPDX-License-Identifier: MIT
#include "acquire/config.hpp"

#include <filesystem>
#include <limits>

#include "drivers/core/settings.hpp"
#include "drivers/radar/profile.hpp"

namespace echofuse::acquire {
namespace {

// As the file spells it; whole numbers are 64 bits wide there.
struct Keys {
  std::int64_t start_channel, click_channel, bins;
  std::int64_t cli_baud, data_baud, width, height, fps;
  std::string cfg;
};

Keys defaults_of(const Config& c) {
  return {c.histogram.start_channel,
          c.histogram.click_channel,
          c.histogram.bins,
          c.radar.cli_baud,
          c.radar.data_baud,
          c.depth.width,
          c.depth.height,
          c.depth.fps,
          ""};
}

void bind_policy(Settings& s, Config& c, const std::string& section, Sensor sensor) {
  s.add(section + ".policy", c.policy[static_cast<std::size_t>(sensor)],
        "required: no start without it, and records without it are marked incomplete",
        {"optional", "required"});
}

void bind(Settings& s, Config& c, Keys& k) {
  constexpr std::int64_t channel_max = std::numeric_limits<std::int32_t>::max();
  s.add("run.window_s", c.window_s, 0.05, 3600, "length of a slot; every slot gives one record");
  s.add("run.connect_timeout_s", c.connect_timeout_s, 0.1, 3600,
        "how long to wait for all devices before starting with those that are there");
  s.add("run.label", c.label, "label of every record, e.g. what is in front of the sensors");
  s.add("run.operator", c.operator_name, "who records");
  s.add("tdc.address", c.tdc.address,
        "bridge:tcp://HOST:PORT or usb:VVVV:PPPP[:serial]; empty: none");
  bind_policy(s, c, "tdc", Sensor::spd);
  s.add("tdc.start_channel", k.start_channel, -channel_max, channel_max,
        "laser sync; negative for falling edges");
  s.add("tdc.click_channel", k.click_channel, -channel_max, channel_max, "detector");
  s.add("tdc.bin_width_ps", c.histogram.bin_width_ps, 1, 1'000'000'000, "two-way time");
  s.add("tdc.first_bin_ps", c.histogram.first_bin_ps, -1'000'000'000'000, 1'000'000'000'000,
        "start of bin 0 after the laser sync, two-way time");
  s.add("tdc.bins", k.bins, 1, 1 << 24, "number of bins");
  constexpr std::int64_t delay_max = 1'000'000'000'000;
  s.add("tdc.start_delay_ps", c.histogram.start_delay_ps, -delay_max, delay_max,
        "added to the start channel's times, for a tagger that cannot delay by itself");
  s.add("tdc.click_delay_ps", c.histogram.click_delay_ps, -delay_max, delay_max,
        "added to the click channel's times");
  s.add("tdc.dead_time_ps", c.histogram.dead_time_ps, 0, delay_max,
        "a tag so soon after the last one of its channel is removed; 0: none");
  s.add("radar.cli", c.radar.cli,
        "command port: serial:/dev/... or hid:VVVV:PPPP[:serial]; empty: none");
  bind_policy(s, c, "radar", Sensor::radar);
  s.add("radar.data", c.radar.data, "data port: serial:/dev/... or hid:VVVV:PPPP[:serial]");
  s.add("radar.cfg", k.cfg, "TI mmWave .cfg file, sent verbatim; relative to this file's folder");
  s.add("radar.cli_baud", k.cli_baud, 1200, 4'000'000, "of the command port");
  s.add("radar.data_baud", k.data_baud, 1200, 4'000'000, "of the data port");
  s.add("depth.address", c.depth.address,
        "openni:[URI or file.oni] or bridge:tcp://HOST:PORT; empty: none");
  bind_policy(s, c, "depth", Sensor::depth);
  s.add("depth.width", k.width, 0, 1 << 14, "pixels of an OpenNI2 camera; 0: its own choice");
  s.add("depth.height", k.height, 0, 1 << 14, "pixels of an OpenNI2 camera; 0: its own choice");
  s.add("depth.fps", k.fps, 0, 1000, "frames a second of an OpenNI2 camera; 0: its own choice");
}

void take_numbers(Config& c, const Keys& k) {
  c.histogram.start_channel = static_cast<std::int32_t>(k.start_channel);
  c.histogram.click_channel = static_cast<std::int32_t>(k.click_channel);
  c.histogram.bins = static_cast<std::uint32_t>(k.bins);
  c.radar.cli_baud = static_cast<std::uint32_t>(k.cli_baud);
  c.radar.data_baud = static_cast<std::uint32_t>(k.data_baud);
  c.depth.width = static_cast<std::uint32_t>(k.width);
  c.depth.height = static_cast<std::uint32_t>(k.height);
  c.depth.fps = static_cast<std::uint32_t>(k.fps);
}

// What a single key cannot show. One line each.
std::vector<std::string> faults_of(Config& c, const Keys& k, const std::filesystem::path& folder) {
  std::vector<std::string> faults;
  const auto attempt = [&](auto body) {
    try {
      body();
    } catch (const Error& e) {
      faults.emplace_back(e.what());
    }
  };
  if (c.configured() == 0)
    faults.emplace_back(
        "no device; expected at least one of tdc.address, radar.cli, depth.address");
  constexpr const char* keys[][2] = {{"tdc.policy", "tdc.address"},
                                     {"radar.policy", "radar.cli"},
                                     {"depth.policy", "depth.address"}};
  for (std::size_t i = 0; i < sensor_count; ++i)
    if ((c.required() & ~c.configured()) >> i & 1u)
      faults.push_back(std::string(keys[i][0]) + " is \"required\", but " + keys[i][1] +
                       " is empty");
  attempt([&] { const tdc::Histogram check(c.histogram); });
  if (c.radar.cli.empty() != c.radar.data.empty())
    faults.emplace_back("radar.cli and radar.data belong together; one of them is empty");
  if (!c.radar.cli.empty() && k.cfg.empty())
    faults.emplace_back("radar.cfg is empty; expected a TI mmWave .cfg file");
  if (!c.radar.cli.empty() && !k.cfg.empty()) {
    attempt([&] {
      const auto path = folder / k.cfg;
      c.radar.cfg_name = path.string();
      c.radar.cfg_text = read_config_text(path);
      radar::parse_profile(c.radar.cfg_text, c.radar.cfg_name);
    });
  }
  return faults;
}

}  // namespace

std::uint32_t Config::configured() const {
  return (tdc.address.empty() ? 0u : 1u) | (radar.cli.empty() ? 0u : 2u) |
         (depth.address.empty() ? 0u : 4u);
}

std::uint32_t Config::required() const {
  std::uint32_t bits = 0;
  for (std::size_t i = 0; i < sensor_count; ++i) bits |= (policy[i] == "required" ? 1u : 0u) << i;
  return bits;
}

Config load_config(const std::string& path, const std::vector<std::string>& assignments) {
  Config config;
  Keys keys = defaults_of(config);
  Settings settings;
  bind(settings, config, keys);
  config.text = read_config_text(path);
  settings.read_text(config.text, path);
  for (const auto& a : assignments) settings.set(a);
  take_numbers(config, keys);
  std::string all;
  for (const auto& fault : faults_of(config, keys, std::filesystem::path(path).parent_path()))
    all += (all.empty() ? "" : "\n") + path + ": " + fault;
  if (!all.empty()) throw Error(ExitCode::config, all);
  config.resolved = settings.resolved(true);
  return config;
}

}  // namespace echofuse::acquire

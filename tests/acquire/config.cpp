// SPDX-License-Identifier: MIT
#include "acquire/config/config.hpp"

#include <regex>

#include "testing.hpp"

using namespace echofuse::acquire;

namespace {

std::string refusal(const std::string& path, const std::vector<std::string>& sets = {}) {
  return refusal_by([&] { load_config(path, sets); });
}

}  // namespace

TEST_CASE("the shipped configuration and its radar cfg can be loaded") {
  const Config config = load_config(source_dir + "/config/lab.toml", {"run.window_s=0.5"});
  CHECK(config.configured() == SensorSet::from_bits(7));
  CHECK(config.window_s == 0.5);
  CHECK(config.histogram.bins == 336);
  CHECK(has(config.radar.cfg_text, "sensorStart"));
  CHECK(has(config.text, "# Configuration of the daemon"));
  CHECK(has(config.resolved, "window_s = 0.5"));
  // The template has placeholders instead of serial numbers in radar.cli and radar.data.
  const std::string lab = source_dir + "/config/lab.toml", why = "still contains the template's";
  REQUIRE(config.unfinished.size() == 2);
  CHECK_THAT(config.unfinished[0], Catch::StartsWith(lab + ":39:1: radar.cli: " + why));
  CHECK_THAT(config.unfinished[1], Catch::StartsWith(lab + ":40:1: radar.data: " + why));
}

TEST_CASE("a missing alert.on_doubt program is reported with its line, and loading continues") {
  const Folder folder;
  const std::string path = folder / "a.toml";
  write_file(path, "[depth]\naddress = \"openni:\"\n[alert]\non_doubt = [\"./alert\", \"lab\"]\n");
  const Config missing = load_config(path);
  REQUIRE(missing.unfinished.size() == 1);
  CHECK(missing.unfinished[0] == path + ":4:1: alert.on_doubt: " + (folder / "./alert") +
                                     ": not found, or not executable by this user");
  write_file(folder / "alert", "#!/bin/sh\n");
  CHECK(load_config(path).unfinished.size() == 1);  // the program exists but is not executable
  fs::permissions(folder / "alert", fs::perms::owner_all);
  CHECK(load_config(path).unfinished.empty());
  // A name without a folder is searched in the folder of the configuration before PATH.
  const auto program = [&](const std::string& name) {
    return load_config(path, {"alert.on_doubt=[\"" + name + "\"]"}).on_doubt[0];
  };
  CHECK(program("sh") == "sh");
  CHECK(program("alert") == folder / "alert");
  write_file(folder / "sh", "#!/bin/sh\n");
  CHECK(program("sh") == folder / "sh");
}

TEST_CASE("a configuration that is printed with all values is unchanged when it is loaded again") {
  const Folder folder;
  write_file(folder / "a.toml",
             "[depth]\naddress = 'openni:'\nmap_size = 256\nmap_half_tangent = 0.3\n"
             "[tdc]\nclick_channel = 7\nclick_delay_ps = -6\ndead_time_ps = 22000\n");
  const Config once = load_config(folder / "a.toml");
  CHECK(once.configured() == SensorSet::from_bits(4));
  write_file(folder / "b.toml", once.resolved);
  const Config twice = load_config(folder / "b.toml");
  CHECK(twice.resolved == once.resolved);
  CHECK(twice.histogram.click_channel == 7);
  CHECK(twice.histogram.click_delay_ps == -6);
  CHECK(twice.histogram.dead_time_ps == 22'000);
  CHECK(twice.map == record::MapGrid{256, 0.3});
  CHECK(has(refusal(folder / "a.toml", {"depth.map_size=257"}), "depth.map_size"));
}

TEST_CASE("the configuration loader refuses keys that are not valid or not consistent") {
  // In the words, @ is the path of the configuration, and & that of its folder with a slash.
  struct Refused {
    std::string text;
    std::vector<std::string> sets, words;
  };
  const std::string tdc = "[tdc]\naddress = 'bridge:tcp://h:1'\n", camera = "[depth]\naddress = ",
                    bridged = "[radar]\naddress = 'bridge:tcp://h:1'\n";
  const Refused refused[] = {
      {"", {}, {"@: no device is configured; expected at least one of tdc.address"}},
      {"[run]\nwindow = 3\n[tdc]\nbins = 'many'\n[depth]\naddres = 'openni:'\n",
       {},
       {"@:2:1: unknown key \"run.window\"; the most similar known name is \"run.window_s\"",
        "@:4:1: tdc.bins = 'many' is not valid; expected a whole number",
        "@:6:1: unknown key \"depth.addres\""}},
      {"\n[radar]\ncli = ''\n", {}, {"@:3:1: radar.cli: no device is configured; expected"}},
      {"[tdc]\naddress = 'openni:'\n[radar]\ncli = 'bridge:tcp://h:1'\ndata = 'hid:10c4:ea80'\n"
       "cfg = 'r.cfg'\ndata_baud = 200\n",
       {"depth.address=carrier:pigeon", "radar.data_baud=4000000"},
       {"@:2:1: tdc.address: address \"openni:\": expected the address of a time tagger: bridge:",
        "@:4:1: radar.cli: address \"bridge:tcp://h:1\": expected the address of a radar port: "
        "serial:",
        "@:5:1: radar.data: ", "@:6:1: radar.cfg: &r.cfg: cannot read",
        "@:7:1: radar.data_baud = 200 is not valid",
        "--set depth.address=carrier:pigeon: address \"carrier:pigeon\": expected the address of a "
        "depth camera: openni:[URI or file.oni] or bridge:tcp"}},
      {"[radar]\ncli = 'serial:/dev/ttyACM0'\n",
       {},
       {"one of radar.cli and radar.data is empty", "radar.cfg is empty"}},
      {tdc + camera + "'bridge:tcp://h:1'\n",
       {"radar.cli=serial:/a", "radar.data=serial:/a"},
       {"@:4:1: depth.address: tdc.address and depth.address are the same port",
        "--set radar.data=serial:/a: radar.cli and radar.data are the same port"}},
      {bridged,
       {"radar.cli=serial:/a", "radar.data=serial:/b"},
       {"@:2:1: radar.address: radar.address cannot be combined with radar.cli and"}},
      {bridged, {"radar.address=usb:1234:5678"}, {"expected the address of a radar: bridge:tcp:"}},
      {tdc + "click_channel = 1\n",
       {},
       {"@:3:1: tdc.click_channel: start and click have the same channel 1"}},
      {camera + "'openni:'\n",
       {"radar.policy=required"},
       {"--set radar.policy=required: the sensor is required, but radar.cli is empty"}},
      {camera + "'openni:'\n",
       {"tdc.policy=must", "tdc.bins=0"},
       {"\"optional\" \"required\"", "expected a whole number from 1"}},
      {camera + "'openni:'\n",
       {"run.calibration=no.toml"},
       {"--set run.calibration=no.toml: &no.toml: cannot read: No such file or directory"}},
  };
  const Folder folder;
  const std::string path = folder / "a.toml";
  for (const auto& [text, sets, words] : refused) {
    write_file(path, text);
    const std::string said = refusal(path, sets);
    CAPTURE(said);
    for (std::string part : words) {
      part = std::regex_replace(part, std::regex("@"), path);
      CHECK_THAT(said, Catch::Contains(std::regex_replace(part, std::regex("&"), folder / "")));
    }
  }
  // One error does not cause further messages.
  for (const std::string& text :
       {std::string("[tdc]\naddress = bridge:tcp://h:1\n"), std::string("[tdc]\naddress = 5\n"),
        std::string("[tdc\naddress = \"x\"\n"), tdc + "start_channel = 07\nclick_channel = 1\n",
        std::string("[radar]\ncli = \"serial:/a\"\ndata = serial:/b\ncfg = \"r.cfg\"\n")}) {
    write_file(path, text);
    CHECK_THAT(refusal(path), !Catch::Contains("\n") && !Catch::Equals(""));
  }
  write_file(path, bridged);
  CHECK(load_config(path).configured() == SensorSet::from_bits(2));
  write_file(path, camera + "'openni:'\npolicy = 'required'\n");
  CHECK(load_config(path).required() == SensorSet::from_bits(4));
}

TEST_CASE("a configuration with an invalid radar cfg is refused") {
  const Folder folder;
  const std::string path = folder / "a.toml", at = path + ":4:1: radar.cfg: " + folder / "r.cfg",
                    wide = ": is UTF-16 or not a text file; save it as UTF-8 or ASCII";
  write_file(path, "[radar]\ncli = \"serial:/a\"\ndata = \"serial:/b\"\ncfg = \"r.cfg\"\n");
  std::string far = contents(source_dir + "/config/radar/xwr68xx_44mm.cfg");
  far.replace(far.find("profileCfg 0 6"), 14, "profileCfg 0 7");
  const std::pair<std::string, std::vector<std::string>> refused[] = {
      {far, {"GHz (limits 60 to 64 GHz)"}},
      {std::string("\xff\xfe%\0\n\0", 6), {at + wide}},
      {"sensorStop\nprofileCfg 0 60\n", {at + ": has no frameCfg"}},
      {"profileCfg\nframeCfg 0 0\nchannelCfg 0 0\nchirpCfg\nguiMonitor\nsensorStart\n",
       {at + ":3: channelCfg '0' should be a whole", at + ":1: profileCfg ", at + ":2: frameCfg ",
        at + ":5: guiMonitor ", at + ":6: sensorStart requires adcCfg, adcbufCfg"}}};
  for (const auto& [cfg, words] : refused) {
    write_file(folder / "r.cfg", cfg);
    for (const std::string& part : words) CHECK_THAT(refusal(path), Catch::Contains(part));
  }
  write_file(folder / "wide.toml", std::string("\xff\xfe[\0", 4));
  CHECK(refusal(folder / "wide.toml") == folder / "wide.toml" + wide);
}

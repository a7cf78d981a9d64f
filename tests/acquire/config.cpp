// SPDX-License-Identifier: MIT
#include "acquire/config/config.hpp"

#include "../fixtures/paths.hpp"
#include "testing.hpp"

using namespace echofuse;
using namespace echofuse::acquire;
using namespace echofuse::test;

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
  REQUIRE(config.unfinished.size() == 2);
  CHECK(has(config.unfinished[0],
            "config/lab.toml:39:1: radar.cli: still contains the template's XXX"));
  CHECK(has(config.unfinished[1],
            "config/lab.toml:40:1: radar.data: still contains the template's XXX"));
}

TEST_CASE(
    "a missing alert.on_doubt program is reported with line and column, and loading continues") {
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
  CHECK(load_config(path, {"alert.on_doubt=[\"sh\"]"}).unfinished.empty());

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
             "[depth]\naddress = \"openni:\"\nmap_size = 256\nmap_half_tangent = "
             "0.3\n[tdc]\nclick_channel = 7\n"
             "click_delay_ps = -6\ndead_time_ps = 22000\n");
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

TEST_CASE("the configuration loader reports all errors together, with line and column") {
  const Folder folder;
  const std::string path = folder / "a.toml";
  write_file(path, "[run]\nwindow = 3\n[tdc]\nbins = \"many\"\n[depth]\naddres = \"openni:\"\n");
  const std::string text = refusal(path);
  CHECK(has(
      text,
      path + ":2:1: unknown key \"run.window\"; the most similar known name is \"run.window_s\""));
  CHECK(has(text, path + ":4:1: tdc.bins = 'many' is not valid; expected a whole number"));
  CHECK(has(text, path + ":6:1: unknown key \"depth.addres\""));
}

TEST_CASE("the configuration loader checks that the keys are consistent") {
  const Folder folder;
  const std::string path = folder / "a.toml";
  SECTION("a configuration without any device is refused") {
    write_file(path, "");
    CHECK(has(refusal(path),
              path + ": no device is configured; expected at least one of tdc.address"));
    write_file(path, "\n[radar]\ncli = \"\"\n");
    CHECK(has(refusal(path), path + ":3:1: radar.cli: no device is configured; expected"));
  }
  SECTION("all invalid device addresses are reported") {
    write_file(path,
               "[tdc]\naddress = \"openni:\"\n[radar]\ncli = \"bridge:tcp://h:1\"\n"
               "data = \"hid:10c4:ea80\"\ncfg = \"r.cfg\"\ndata_baud = 200\n");
    const std::string text =
        refusal(path, {"depth.address=carrier:pigeon", "radar.data_baud=4000000"});
    CHECK(has(text, path + ":2:1: tdc.address: address \"openni:\": expected the address of a time "
                           "tagger: bridge:"));
    CHECK(has(text, path + ":4:1: radar.cli: address \"bridge:tcp://h:1\": expected the address of "
                           "a radar port: serial:"));
    CHECK(has(text, path + ":5:1: radar.data: "));
    CHECK(has(text, path + ":6:1: radar.cfg: " + folder / "r.cfg: cannot read"));
    CHECK(has(text, path + ":7:1: radar.data_baud = 200 is not valid"));
    CHECK(has(text,
              "--set depth.address=carrier:pigeon: address \"carrier:pigeon\": expected the "
              "address of a depth camera: openni:[URI or file.oni] or bridge:tcp"));
  }
  SECTION("a radar with only one serial port and no cfg is refused") {
    write_file(path, "[radar]\ncli = \"serial:/dev/ttyACM0\"\n");
    CHECK(has(refusal(path), "one of radar.cli and radar.data is empty"));
    CHECK(has(refusal(path), "radar.cfg is empty"));
  }
  SECTION("two sensors or ports with the same address are refused") {
    write_file(path,
               "[tdc]\naddress = \"bridge:tcp://h:1\"\n[depth]\naddress = \"bridge:tcp://h:1\"\n");
    CHECK(has(refusal(path),
              path + ":4:1: depth.address: tdc.address and depth.address are the same port"));
    CHECK(has(refusal(path, {"radar.cli=serial:/a", "radar.data=serial:/a"}),
              "--set radar.data=serial:/a: radar.cli and radar.data are the same port"));
  }
  SECTION("a radar that is connected through a bridge needs neither a cfg nor serial ports") {
    write_file(path, "[radar]\naddress = \"bridge:tcp://h:1\"\n");
    CHECK(load_config(path).configured() == SensorSet::from_bits(2));
    CHECK(has(refusal(path, {"radar.cli=serial:/a", "radar.data=serial:/b"}),
              path + ":2:1: radar.address: radar.address cannot be combined with radar.cli and"));
    CHECK(has(refusal(path, {"radar.address=usb:1234:5678"}),
              "expected the address of a radar: bridge:tcp:"));
  }
  SECTION("a missing or invalid radar cfg is refused") {
    write_file(path, "[radar]\ncli = \"serial:/a\"\ndata = \"serial:/b\"\ncfg = \"r.cfg\"\n");
    CHECK(has(refusal(path), folder / "r.cfg: cannot read"));
    std::string far = shell("cat " + source_dir + "/config/radar/xwr68xx_44mm.cfg").text;
    write_file(folder / "r.cfg", far.replace(far.find("profileCfg 0 6"), 14, "profileCfg 0 7"));
    CHECK(has(refusal(path), "GHz (limits 60 to 64 GHz)"));
    const std::string wide = ": is UTF-16 or not a text file; save it as UTF-8 or ASCII";
    write_file(folder / "r.cfg", std::string("\xff\xfe%\0\n\0", 6));
    CHECK(has(refusal(path), path + ":4:1: radar.cfg: " + folder / "r.cfg" + wide));
    write_file(folder / "wide.toml", std::string("\xff\xfe[\0", 4));
    CHECK(refusal(folder / "wide.toml") == folder / "wide.toml" + wide);
    write_file(folder / "r.cfg", "sensorStop\nprofileCfg 0 60\n");
    CHECK(has(refusal(path), path + ":4:1: radar.cfg: " + folder / "r.cfg: has no frameCfg"));
    write_file(folder / "r.cfg",
               "profileCfg\nframeCfg 0 0\nchannelCfg 0 0\nchirpCfg\nguiMonitor\nsensorStart\n");
    const std::string text = refusal(path);
    for (const char* line :
         {"r.cfg:3: channelCfg '0' should be a whole", "r.cfg:1: profileCfg ", "r.cfg:2: frameCfg ",
          "r.cfg:5: guiMonitor ", "r.cfg:6: sensorStart requires adcCfg, adcbufCfg"})
      CHECK(has(text, path + ":4:1: radar.cfg: " + folder / line));
  }
  SECTION("a histogram with the same start and click channel is refused") {
    write_file(path, "[tdc]\naddress = \"bridge:tcp://h:1\"\nclick_channel = 1\n");
    CHECK(has(refusal(path),
              path + ":3:1: tdc.click_channel: start and click have the same channel 1"));
  }
  SECTION("a required sensor without an address is refused") {
    write_file(path, "[depth]\naddress = \"openni:\"\npolicy = \"required\"\n");
    CHECK(load_config(path).required() == SensorSet::from_bits(4));
    CHECK(has(refusal(path, {"radar.policy=required"}),
              "--set radar.policy=required: the sensor is required, but radar.cli is empty"));
    CHECK(has(refusal(path, {"tdc.policy=must"}), "\"optional\" \"required\""));
  }
  SECTION("one configuration error does not cause further error messages") {
    for (const char* text :
         {"[tdc]\naddress = bridge:tcp://h:1\n", "[tdc]\naddress = 5\n", "[tdc\naddress = \"x\"\n",
          "[tdc]\naddress = \"bridge:tcp://h:1\"\nstart_channel = 07\nclick_channel = 1\n",
          "[radar]\ncli = \"serial:/a\"\ndata = serial:/b\ncfg = \"r.cfg\"\n"}) {
      write_file(path, text);
      CAPTURE(text, refusal(path));
      CHECK_FALSE(has(refusal(path), "\n"));
    }
  }
  SECTION("an invalid --set assignment is refused") {
    write_file(path, "[depth]\naddress = \"openni:\"\n");
    CHECK(has(refusal(path, {"tdc.bin=3"}), "most similar known name is \"tdc.bins\""));
    CHECK(has(refusal(path, {"tdc.bins=0"}), "expected a whole number from 1"));
    CHECK(refusal(path, {"run.calibration=no.toml"}) ==
          "--set run.calibration=no.toml: " +
              folder / "no.toml: cannot read: No such file or directory");
  }
}

// SPDX-License-Identifier: MIT
// Tests the radar driver on the pseudo-terminals of a simulated laboratory, at real baud rates.
#include <optional>

#include "../drivers/sink.hpp"
#include "drivers/port/open_port.hpp"
#include "drivers/radar/radar_driver.hpp"
#include "lab_thread.hpp"

using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

struct Lines {
  explicit Lines(const sim::LabOptions& options, const std::string& data_dir = {}) {
    radar::RadarSetup setup;
    const std::string& data = data_dir.empty() ? options.dir : data_dir;
    setup.cli = loop.opener("serial:" + options.dir + "/radar-cli", 115200);
    setup.data = loop.opener("serial:" + data + "/radar-data", 921600);
    setup.keep_running = true;
    setup.cfg_text = contents(options.dir + "/radar.cfg");
    driver.emplace(loop, setup);
    driver->start(sink);
  }
  bool frames(std::size_t count) {
    return run_until(loop, [&] { return sink.radar.size() >= count; });
  }
  port::SystemLoop loop;
  KeepingSink sink;
  std::optional<radar::RadarDriver> driver;
};

}  // namespace

TEST_CASE("the radar driver counts frames that are lost while it does not read the port") {
  const Folder dir;
  sim::LabOptions options = options_in(dir);
  options.radar_cfg = dir / "fast.cfg";
  std::string cfg = contents(source_dir + "/config/radar/xwr68xx_44mm.cfg");
  cfg.replace(cfg.find("frameCfg 0 2 32 0 50"), 20, "frameCfg 0 2 32 0 10");
  std::ofstream(options.radar_cfg) << cfg;
  LabThread lab(options);
  Lines lines(options);
  REQUIRE(lines.frames(3));
  // The board sends 192 kB in 3 s. The kernel buffers only part of this amount.
  std::this_thread::sleep_for(3s);
  // At least half of the 300 frames are lost. On a busy machine, the board may send fewer than 300
  // frames.
  REQUIRE(run_until(lines.loop, [&] { return counter(*lines.driver, "lost_frames") > 150; }));
  const std::uint32_t first = lines.sink.radar.front().frame_number;
  const std::uint32_t last = lines.sink.radar.back().frame_number;
  WARN("3 s blocked: " << counter(*lines.driver, "lost_frames") << " frames lost");
  CHECK(lines.sink.radar.size() + counter(*lines.driver, "lost_frames") == last - first + 1);
  CHECK(counter(*lines.driver, "connections") == 1);
}

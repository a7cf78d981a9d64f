// SPDX-License-Identifier: MIT
// Tests the folder of the simulated laboratory, and the sequence of its scenes.

#include <optional>
#include <set>

#include "../fixtures/error.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "lab_thread.hpp"

using namespace echofuse::test;
namespace fs = std::filesystem;

namespace {

std::set<std::string> names_in(const std::string& dir) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(dir)) names.insert(entry.path().filename());
  return names;
}

std::string refusal(const sim::LabOptions& options, ExitCode code) {
  port::SystemLoop loop;
  return refusal_by([&] { sim::Lab lab(loop, options); }, code);
}

}  // namespace

TEST_CASE("the simulated laboratory creates its files on start and removes its devices on stop") {
  const Folder dir;
  sim::LabOptions options = options_in(dir);
  options.window_s = 0.2;
  std::optional<LabThread> lab(std::in_place, options);
  CHECK(names_in(options.dir) == std::set<std::string>{"depth.sock", "lab.lock", "lab.toml",
                                                       "openni", "radar-cli", "radar-data",
                                                       "radar.cfg"});
  const std::string toml = contents(options.dir + "/lab.toml");
  for (const std::string& part :
       {std::string("[run]\nwindow_s = 0.2\nlabel = \"person\"\n"),
        std::string("start_channel = 1\nclick_channel = 2\nbin_width_ps = 100\n"
                    "first_bin_ps = 13343\nbins = 336\n"),
        "cli = \"serial:" + options.dir + "/radar-cli\"", std::string("cfg = \"radar.cfg\""),
        std::string("address = \"openni:\"")})
    CHECK_THAT(toml, Catch::Contains(part));
  CHECK(contents(options.dir + "/radar.cfg") ==
        contents(source_dir + "/config/radar/xwr68xx_paper_50cm.cfg"));
  CHECK_THAT(lab->lab().daemon_command(),
             Catch::StartsWith("LD_LIBRARY_PATH=" + options.dir + "/openni ") &&
                 Catch::Contains(" run --config " + options.dir + "/lab.toml --out "));
  lab.reset();
  CHECK(names_in(options.dir) == std::set<std::string>{"lab.toml", "radar.cfg", "sent.json"});
  CHECK_THAT(contents(options.dir + "/sent.json"), Catch::StartsWith("{\"play\":{\"scene\":"));
  // The next laboratory reuses the folder and keeps files of other programs.
  std::ofstream(options.dir + "/run.sqlite") << "a run";
  lab.emplace(options);
  CHECK_FALSE(fs::exists(options.dir + "/sent.json"));
  CHECK(contents(options.dir + "/run.sqlite") == "a run");
}

TEST_CASE("the simulated laboratory refuses a folder that it cannot use") {
  const Folder dir;
  sim::LabOptions options = options_in(dir);
  SECTION("a folder that another laboratory uses is refused") {
    LabThread lab(options);
    CHECK_THAT(refusal(options, ExitCode::usage),
               Catch::Contains("another laboratory is running in this directory"));
    CHECK(fs::exists(options.dir + "/radar-cli"));
  }
  SECTION("a folder path that is too long for a socket is refused") {
    options.dir = dir / std::string(120, 'x');
    CHECK_THAT(refusal(options, ExitCode::usage), Catch::Contains("too long for a socket"));
  }
}

TEST_CASE("start-up errors of the simulated laboratory state the cause and leave no device files") {
  const Folder dir;
  sim::LabOptions no_cfg = options_in(dir), fraction = no_cfg, too_fast = no_cfg;
  no_cfg.radar_cfg = dir / "missing.cfg";
  fraction.conditions.bin_width_ps = 12.5;
  too_fast.tagging.laser_rate_hz = 80e6;
  for (const auto& [options, why] :
       {std::pair{no_cfg, "missing.cfg: cannot read"},
        {fraction, "whole picoseconds"},
        {too_fast, "the next pulse is emitted before the end of the last bin"}}) {
    CHECK_THAT(refusal(options, ExitCode::config), Catch::Contains(why));
    for (const char* name : {"/radar-cli", "/depth.sock", "/lab.toml"})
      CHECK_FALSE(fs::exists(options.dir + name));
  }
}

TEST_CASE("scenes change at the set interval, and 25 % of mixed scenes show people") {
  port::VirtualLoop clock;
  const sim::Conditions conditions;
  sim::ScenePlayer player(clock, conditions, {"mixed", 3, 0.5});
  CHECK(player.at(0.49).index == 0);
  CHECK(player.scene_end_s(0.49) == 0.5);
  CHECK(player.at(0.51).index == 1);
  clock.run_for(std::chrono::seconds(2));
  CHECK(player.at(player.now_s()).index == 4);
  // The laboratory starts in the middle of a scene.
  clock.run_for(std::chrono::milliseconds(8200));
  sim::ScenePlayer later(clock, conditions, {"mixed", 3, 0.5});
  CHECK(later.at(0.299).index == 0);
  CHECK(later.scene_end_s(0.1) == Approx(0.3).epsilon(1e-12));
  CHECK(later.at(later.scene_end_s(0.1)).index == 1);
  CHECK(later.scene_end_s(0.3) == Approx(0.8).epsilon(1e-12));
  int people = 0;
  constexpr int scenes = 4000;
  for (int i = 0; i < scenes; ++i)
    people += sim::ScenePlayer::spec_of({"mixed", 3, 0.5}, i).kind == sim::SceneKind::person;
  CHECK(std::abs(people - scenes / 4.0) < 5 * std::sqrt(scenes * 0.25 * 0.75));
  sim::SceneSchedule listed{"", 3, 0.5};
  listed.list = {sim::SceneKind::empty, sim::SceneKind::letter};
  for (int i = 0; i < 6; ++i)
    CHECK(sim::ScenePlayer::spec_of(listed, i).kind ==
          (i % 2 ? sim::SceneKind::letter : sim::SceneKind::empty));
}

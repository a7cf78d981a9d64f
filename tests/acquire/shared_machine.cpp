// SPDX-License-Identifier: MIT
// Tests a PC that several users share: paths of configurations and runs, access rights and the list
// of runs.
#include <sys/stat.h>

#include <nlohmann/json.hpp>

#include "acquire/record/run_names.hpp"
#include "acquire/run/new_run.hpp"
#include "drivers/util/program.hpp"
#include "testing.hpp"

namespace record = echofuse::record;

namespace {

using Json = nlohmann::json;

const std::string tagger = "[tdc]\naddress = \"bridge:tcp://127.0.0.1:9\"\n";

// Runs a command as a user with `home` as the home folder and no other configuration.
Outcome at_home(const Folder& home, const std::string& variables, const std::string& arguments) {
  return shell("cd " + home / "" + " && env -u ECHOFUSE_CONFIG -u XDG_CONFIG_HOME HOME=" +
               home / "" + " " + variables + " " + bin_dir + "/echofuse-acquire " + arguments);
}

unsigned mode_of(const std::string& path) {
  struct stat file {};
  REQUIRE(::stat(path.c_str(), &file) == 0);
  return file.st_mode & 0777;
}

}  // namespace

TEST_CASE("the configuration file in the current folder takes precedence over the user's file") {
  const Folder folder;
  if (fs::exists("/etc/echofuse/lab.toml")) return;  // an installed lab.toml would be used instead
  CHECK(has(text_of(at_home(folder, "", "config check"), 3),
            "searched ./lab.toml, ~/.config/echofuse/lab.toml, /etc/echofuse"));
  CHECK(at_home(folder, "", "run --count 1").code == 3);
  const auto first_line = [&](const std::string& environment, const std::string& more = "") {
    const std::string shown = text_of(at_home(folder, environment, "config show" + more));
    return shown.substr(0, shown.find('\n'));
  };
  for (const char* name : {".config/echofuse", "xdg/echofuse"}) {
    fs::create_directories(folder / name);
    write_file(folder / name + "/lab.toml", tagger);
  }
  write_file(folder / "other.toml", tagger);
  CHECK(has(first_line(""), "/.config/echofuse/lab.toml (~/.config/echofuse/lab.toml)"));
  const std::string xdg = "XDG_CONFIG_HOME=" + folder / "xdg";
  CHECK(has(first_line(xdg), "/xdg/echofuse/lab.toml ($XDG_CONFIG_HOME/echofuse/lab.toml)"));
  write_file(folder / "lab.toml", tagger);
  CHECK(first_line(xdg) == "# lab.toml (./lab.toml)");
  CHECK(first_line("ECHOFUSE_CONFIG=other.toml") == "# other.toml ($ECHOFUSE_CONFIG)");
  CHECK(first_line("ECHOFUSE_CONFIG=none", " --config lab.toml") == "# lab.toml (--config)");
  CHECK(has(text_of(at_home(folder, "ECHOFUSE_CONFIG=none.toml", "doctor"), 3), "none.toml: can"));
}

TEST_CASE("a radar cfg is searched for next to the configuration file, then among installed cfgs") {
  const Folder folder;
  const std::string radar = "[radar]\ncli = \"serial:/dev/a\"\ndata = \"serial:/dev/b\"\ncfg = ";
  write_file(folder / "lab.toml", tagger + radar + "\"radar/xwr68xx_paper_50cm.cfg\"\n");
  CHECK(at_home(folder, "", "config check").text == "lab.toml: ok\n");
  write_file(folder / "lab.toml", tagger + radar + "\"radar/mine.cfg\"\n");
  CHECK(has(at_home(folder, "", "config check").text, "radar/mine.cfg: cannot read"));
}

TEST_CASE("a run without a name gets the next number of the day in the configured folder") {
  const Folder folder;
  const std::string first = record::next_run(folder / ""), day = first.substr(0, first.size() - 10);
  CHECK_THAT(first, Catch::StartsWith(folder / "20") && Catch::EndsWith("-001.sqlite"));
  write_file(day + "008.sqlite", "");
  write_file(day + "009.rescued.sqlite", "");
  write_file(folder / "19990101-500.sqlite", "");
  CHECK(record::next_run(folder / "") == day + "010.sqlite");
  write_file(folder / "lab.toml", "[run]\nfolder = \"runs\"\n" + tagger);
  const auto config = echofuse::acquire::load_config(folder / "lab.toml");
  CHECK(config.run_folder == folder / "runs");
}

TEST_CASE("the operator of a run is the configured name or the user name") {
  const Folder folder;
  CHECK_FALSE(echofuse::login_name().empty());
  for (const std::string name : {"", "Ada"}) {
    echofuse::acquire::Config config;
    config.operator_name = name;
    const auto run = acquire::make_run(config, folder / ("run" + name), {}, "", system_clock);
    CHECK(record::RunReader(run->path()).info().operator_name ==
          (name.empty() ? echofuse::login_name() : name));
  }
}

TEST_CASE("a live run file is readable by the group, whatever the umask") {
  const Folder folder;
  const mode_t before = ::umask(0077);
  {
    const auto run = a_small_run(0).open(folder / "a.sqlite");
    for (const char* name : {"a.sqlite", "a.sqlite-wal", "a.sqlite-shm", "a.sqlite-lock"})
      CHECK(mode_of(folder / name) == 0640);
    run->close("complete");
  }
  ::umask(before);
  CHECK(mode_of(folder / "a.sqlite") == 0640);
}

TEST_CASE("the list command shows notes that were added during and after a run") {
  const Folder folder;
  a_small_run(2).started("2026-11-23T08:00:00.000Z").write(folder / "monday.sqlite");
  a_small_run(3).started("2026-11-24T08:00:00.000Z").write(folder / "tuesday.sqlite");
  write_file(folder / "other.sqlite", "no database");
  write_file(folder / "text.txt", "no run");
  for (const char* note : {"first light", "the lens was dirty"})
    CHECK(test::acquire("annotate " + folder / "monday" + " '" + note + "'").code == 0);
  CHECK(test::acquire("annotate " + folder / "other" + " text").code == 1);
  const std::string text = text_of(test::acquire("list " + folder / ""));
  CHECK(has(text, "monday   2026-11-23T08:00"));
  CHECK(has(text, "first light; the lens was dirty\n"));
  CHECK(text.find("monday") < text.find("tuesday"));
  CHECK(has(text, "not listed: " + folder / "other.sqlite: not an echofuse run file"));
  CHECK_FALSE(has(text, "text.txt"));
  const std::string program = bin_dir + "/echofuse-acquire";
  const Json all = Json::parse(
      shell("(" + program + " list --json " + folder / "" + " 2>/dev/null)").text)["runs"];
  REQUIRE(all.size() == 2);
  CHECK(all[0]["name"] == "monday");
  CHECK(all[0]["notes"] == Json::array({"a test", "first light", "the lens was dirty"}));
  CHECK(all[1]["notes"] == Json::array({"a test"}));
  CHECK(all[1]["valid"]["spd"] == 3);
  CHECK(has(test::acquire("info " + folder / "monday").text, "  note      20"));
  CHECK(test::acquire("list " + folder / "none").code == 1);
  // Adding a note leaves only the run file behind, as does the end of a run.
  CHECK_FALSE(fs::exists(folder / "monday.sqlite-wal"));
}

TEST_CASE("the list command shows live runs and their state") {
  const Folder folder, locks;
  const auto run = a_small_run(1).open(folder / "live.sqlite");
  const Json told = Json::parse(
      at_home(folder, "ECHOFUSE_LOCKS=" + locks / "", "list --json " + folder / "" + " | cat")
          .text)["runs"];
  REQUIRE(told.size() == 1);
  CHECK(told[0]["status"] == "open");
  CHECK(told[0]["live"]["last_index"] == 0);
  CHECK(told[0]["live"]["sensors"]["spd"]["verdict"] == "ok");
  CHECK(has(test::acquire("list " + folder / "").text, "live.sqlite is live; its last record is "));
  const Folder elsewhere;
  CHECK_FALSE(has(at_home(elsewhere, "", "list").text, "live"));
}

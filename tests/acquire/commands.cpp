// SPDX-License-Identifier: MIT
// Tests echofuse-acquire as users see it: exit codes, error messages and output.
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "testing.hpp"

namespace {

using Json = nlohmann::json;

// Loopback address on which no server listens. Each test process uses its own address, because
// programs lock devices by address.
const std::string host = [] {
  const auto pid = static_cast<unsigned>(::getpid());
  return "127." + std::to_string(pid >> 16 & 255u) + '.' + std::to_string(pid >> 8 & 255u) + '.' +
         std::to_string(pid & 255u);
}();
const std::string nowhere = "bridge:tcp://" + host + ":9";
const std::string tdc_nowhere = "[tdc]\naddress = \"" + nowhere + "\"\n";

void refuses(const std::string& arguments, int code, const std::string& saying) {
  CAPTURE(arguments);
  CHECK_THAT(text_of(acquire(arguments), code), Catch::Contains(saying));
}

Json json_of(const std::string& arguments) { return Json::parse(text_of(acquire(arguments))); }

}  // namespace

TEST_CASE("commands accept --help and --version, and durations such as 1h 30m 10s") {
  for (const char* command : {"", "run", "devices", "doctor", "config", "config check",
                              "config show", "info", "annotate", "list", "calibrate", "import"}) {
    CAPTURE(command);
    const std::string help = text_of(acquire(command + std::string(" --help")));
    CHECK(has(help, "exit codes"));
    CHECK(has(help, "--quiet") == (command != std::string("config")));
  }
  CHECK(has(test::acquire("--version").text, "echofuse-acquire "));
  for (const char* no_time : {"10", "2h30", "30m2h", "2h2h", "h", "''", "2h-30m", "2x", "nans"})
    refuses(std::string("run --out a --duration ") + no_time, 2, "numbers with units");
  // All these durations are valid, so only the missing file is reported.
  for (const char* time : {"2h30m", "'1h 30m 10s'", "90min", "1.5h"})
    refuses(std::string("doctor --config no.toml --duration ") + time, 3, "no.toml");
}

TEST_CASE(
    "config check prints ok or all errors, and config show prints each value with its origin") {
  const Folder folder;
  const std::string path = folder / "lab.toml", config = " --config " + path;
  write_file(path, "[tdc]\naddress = \"bridge:tcp://127.0.0.1:9\"\nbin_width_ps = 50\n");
  CHECK(text_of(test::acquire("config check" + config)) == path + ": ok\n");
  const std::string shown = text_of(test::acquire("config show" + config + " --set tdc.bins=99"));
  CHECK(has(shown, "\nbins = 99  # --set tdc.bins=99\n"));
  CHECK(has(shown, "\nbin_width_ps = 50  # " + path + ":3:1\n"));
  CHECK(has(shown, "\nwindow_s = 3.0  # default\n"));
  const std::string copy = folder / "again.toml";
  write_file(copy, shown);
  refuses("config show --config " + copy, 0, "\nbins = 99  # " + copy + ":");
  const std::string bad = "config check" + config + " --set tdc.bins=0 --set a=1";
  refuses(bad, 3, "--set tdc.bins=0: expected a whole number");
  refuses(bad, 3, "--set a=1: unknown key");
  refuses("config check --config " + folder / "", 3, "is a folder; expected a regular file");
  refuses("config check --config /dev/zero", 3, "/dev/zero: is a device; expected a regular file");
  CHECK(test::acquire("config check --config /dev/stdin < " + path).code == 0);
}

TEST_CASE("commands refuse a FIFO in place of a regular file, and do not block") {
  const Folder folder;
  a_small_run(2).write(folder / "a.sqlite");
  REQUIRE(::mkfifo((folder / "f.sqlite").c_str(), 0666) == 0);
  const std::string fifo = folder / "f.sqlite", why = "f.sqlite: is a FIFO; expected a regular";
  refuses("info /dev/null", 1, "/dev/null: is a device; expected a regular file");
  refuses("config check --config " + fifo, 3, why);
  write_file(folder / "lab.toml", "[tdc]\naddress = \"bridge:tcp://127.0.0.1:9\"\n");
  const std::string set = "config check --config " + folder / "lab.toml" + " --set ";
  refuses(set + "run.calibration=" + fifo, 3, why);
  refuses(set + "radar.cli=serial:/x --set radar.data=serial:/y --set radar.cfg=" + fifo, 3, why);
  for (const char* beside : {"-wal", "-shm", "-journal"}) {
    const std::string name = folder / "a.sqlite" + beside;
    REQUIRE(::mkfifo(name.c_str(), 0666) == 0);
    // Reading a closed run must not open a FIFO that has the name of a SQLite side file (-wal, -shm
    // or -journal).
    CHECK(test::acquire("info " + folder / "a.sqlite").code == 0);
    fs::remove(name);
  }
  CHECK(test::acquire("info " + folder / "a.sqlite").code == 0);
}

TEST_CASE("commands exit with an error if standard output cannot be written") {
  const Folder folder;
  a_small_run(2).write(folder / "a.sqlite");
  write_file(folder / "lab.toml", "[tdc]\naddress = \"bridge:tcp://127.0.0.1:9\"\n");
  for (const std::string& command :
       {"info " + folder / "a", "info --json " + folder / "a",
        "config show --config " + folder / "lab.toml", std::string("--help")}) {
    CAPTURE(command);
    CHECK_THAT(text_of(shell("(" + bin_dir + "/echofuse-acquire " + command + " > /dev/full)"), 1),
               Catch::Contains("stdout: cannot write: No space left on device"));
  }
}

TEST_CASE("the doctor command runs without a configuration file but stops if the file is invalid") {
  const Folder folder;
  const std::string here = "cd " + folder / "" + " && " + bin_dir + "/echofuse-acquire doctor";
  const Json report = Json::parse(text_of(shell(here + " --json")));
  std::vector<std::string> checks;
  for (const auto& check : report["checks"]) checks.push_back(check["check"]);
  CHECK(std::count(checks.begin(), checks.end(), "clock") == 1);
  CHECK(std::count(checks.begin(), checks.end(), "disk rate") == 1);
  CHECK(std::count(checks.begin(), checks.end(), "spd") == 0);
  CHECK(fs::is_empty(folder / ""));
  write_file(folder / "lab.toml",
             tdc_nowhere + "[run]\nfolder = \"no\"\nconnect_timeout_s = 0.2\n");
  CHECK(has(text_of(shell(here), 4), "cannot be used for a run"));
  const std::string hook = " --set 'alert.on_doubt=[\"nowhere.sh\"]'";
  const std::string missing = text_of(shell(here + hook), 3);
  CHECK(has(missing, "problem  configuration --set alert.on_doubt"));
  CHECK(has(missing, "nowhere.sh: not found, or not executable by this user"));
  for (const char* command : {"config check", "run --count 1"})
    refuses(command + (" --config " + folder / "lab.toml") + hook, 3, "nowhere.sh: not found");
}

TEST_CASE("the run command refuses a read-only folder") {
  const Folder folder;
  write_file(folder / "lab.toml", tdc_nowhere);
  const std::string config = " --config " + folder / "lab.toml";
  refuses("run --out " + folder / "a" + config + " --meta irf_fwhm_ps=0.35", 2,
          "--meta: irf_fwhm_ps is 0.35 ps, but the bins have 100 ps: is the width in ns?");
  write_file(folder / "calibration.toml",
             "[spd]\noffset_m = 0.1\n[response]\nirf_fwhm_ps = \"0.35\"\n");
  refuses("config check" + config + " --set run.calibration=calibration.toml", 3,
          "/calibration.toml: irf_fwhm_ps is 0.35 ps, but the bins have 100 ps");
  fs::create_directory(folder / "closed");
  fs::permissions(folder / "closed", fs::perms::owner_read | fs::perms::owner_exec);
  // If the test runs as root, the command drops its privileges, because root may write to a
  // read-only folder.
  const std::string as_user = geteuid() == 0 ? "setpriv --bounding-set=-all --inh-caps=-all " : "";
  const std::string run = "/echofuse-acquire run --out " + folder / "closed/a";
  CHECK(has(text_of(shell(as_user + bin_dir + run + config), 6),
            "closed/a.sqlite: its folder is not writable: Permission denied"));
}

TEST_CASE("calibrate runs without a calibration file and never overwrites an unreadable one") {
  const Folder folder;
  write_file(folder / "lab.toml",
             "[run]\nconnect_timeout_s = 0.2\ncalibration = \"c.toml\"\n" + tdc_nowhere);
  const std::string config = "calibrate --repeat 3 --time 0.1 --config " + folder / "lab.toml";
  refuses(config, 4, "warning spd: " + nowhere.substr(nowhere.rfind('/') + 1) + ": ");
  refuses(config + " --check", 3,
          "lab.toml:3:1: run.calibration: " + folder / "c.toml: cannot read");
  for (const std::string text : {"[spd]\noffset_cm = 6\n", ""}) {
    write_file(folder / "c.toml", text);
    refuses(config, 3, "c.toml is not overwritten; remove it or set another run.calibration");
    CHECK(fs::file_size(folder / "c.toml") == text.size());
  }
  refuses(config + " --set run.calibration=new.toml", 4,
          "the devices to calibrate delivered no data within 0.2 s");
}

TEST_CASE("a run with silent devices reports each device in one line and creates no file") {
  const Folder folder;
  write_file(folder / "lab.toml", "[run]\nconnect_timeout_s = 0.3\n" + tdc_nowhere +
                                      "[radar]\ncli = \"serial:" + folder / "cli" +
                                      "\"\ndata = \"serial:" + folder / "data" + "\"\ncfg = \"" +
                                      source_dir + "/config/radar/xwr68xx_paper_50cm.cfg\"\n");
  const std::string config = " --config " + folder / "lab.toml";
  const std::string said = text_of(test::acquire("run -q --out " + folder / "a" + config), 4);
  CHECK(has(said, "\nspd " + nowhere + ": faulted: "));
  CHECK(has(said, "\nradar serial:" + folder / "cli" + ": faulted: "));
  CHECK_FALSE(fs::exists(folder / "a.sqlite"));
  const Json list = Json::parse(text_of(test::acquire("devices --json" + config), 4))["configured"];
  REQUIRE(list.size() == 2);
  CHECK(list[0]["answers"] == false);
}

TEST_CASE("the devices command lists attached devices if no configuration file exists") {
  const Folder folder;
  const Json all = Json::parse(
      text_of(shell("cd " + folder / "" + " && " + bin_dir + "/echofuse-acquire devices --json")));
  CHECK(all["configured"] == Json::array());
  CHECK(all["attached"]["usb"].is_array());
  CHECK(all["attached"]["openni"].is_array());
  CHECK(
      has(test::acquire("--version").text, "), " + all["instructions"].get<std::string>() + "\n"));
}

TEST_CASE("the info command prints the status, the counts, the labels and the axes of a run") {
  const Folder folder;
  const std::string run = folder / "a.sqlite";
  a_small_run(6).write(run);
  const Json info = json_of("info --json " + run);
  CHECK(info["records"] == 6);
  CHECK(info["status"] == "complete");
  CHECK(info["valid"] == Json{{"spd", 6}, {"radar", 6}, {"depth", 6}});
  CHECK(info["lost"]["depth"] == 12);
  CHECK(info["labels"] == Json{{"person", 3}, {"letter:A", 3}});
  CHECK(info["axes"].size() == 4);
  CHECK(info["window_s"] == 0.2);
  CHECK(has(test::acquire("info " + run).text, "6 records, complete"));
}

TEST_CASE("commands find a run by its file name or by the name given to --out") {
  const Folder folder;
  a_small_run(2).write(folder / "m1.sqlite");
  a_small_run(3).write(folder / "plain");
  write_file(folder / "lab.toml", tdc_nowhere);
  CHECK(json_of("info --json " + folder / "m1")["records"] == 2);
  CHECK(json_of("info --json " + folder / "plain")["records"] == 3);
  CHECK(has(test::acquire("annotate " + folder / "m1" + " door").text,
            "m1.sqlite: \"door\" noted\n"));
  refuses("annotate " + folder / "m1" + " --label door", 1, "m1.sqlite: run is not being recorded");
  refuses("annotate " + folder / "m1" + " ' '", 2, "the note is empty");
  refuses("annotate " + folder / "m2" + " door", 1, "m2.sqlite: ");
}

TEST_CASE("a run name that is not UTF-8 is escaped in JSON output and refused for a new run") {
  const Folder folder;
  const std::string name = folder / "m\xff.sqlite";
  a_small_run(1).write(name);
  write_file(folder / "lab.toml", tdc_nowhere);
  const std::string shown = folder / "m\\xff.sqlite";
  CHECK(json_of("info --json " + name)["file"] == shown);
  CHECK(json_of("list --json " + folder / "")["runs"][0]["path"] == shown);
  refuses("run --config " + folder / "lab.toml --out n\xff", 2, "--out n\\xff: expected UTF-8");
}

// SPDX-License-Identifier: MIT
// Tests echofuse-acquire as users see it: exit codes, error messages and output.
#include <sys/stat.h>
#include <unistd.h>

#include <nlohmann/json.hpp>
#include <regex>

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

// Folder with a configuration.
struct LabFolder : Folder {
  explicit LabFolder(const std::string& more = "") {
    write_file(lab, more + "[tdc]\naddress = '" + nowhere + "'\nbin_width_ps = 50\n");
  }
  const std::string lab = *this / "lab.toml", config = " --config " + lab;
};

// Checks the exit code and the output of a command.
void says(const std::string& arguments, int code, const std::string& words) {
  CAPTURE(arguments);
  CHECK_THAT(text_of(acquire(arguments), code), Catch::Contains(words));
}

Json json_of(const std::string& arguments) { return Json::parse(text_of(acquire(arguments))); }

}  // namespace

TEST_CASE("all commands accept --help, and the program accepts --version") {
  for (const char* command : {"", "run", "devices", "doctor", "config", "config check",
                              "config show", "info", "annotate", "list", "calibrate", "import"}) {
    CAPTURE(command);
    const std::string help = text_of(acquire(command + std::string(" --help")));
    CHECK(has(help, "exit codes"));
    CHECK(has(help, "--quiet") == (command != std::string("config")));
  }
  CHECK(has(test::acquire("--version").text, "echofuse-acquire "));
}

TEST_CASE("config show prints each value with its origin, and can be loaded again") {
  const LabFolder folder;
  const std::string copy = folder / "again.toml",
                    shown = text_of(test::acquire("config show --set tdc.bins=99" + folder.config));
  CHECK(has(shown, "\nbins = 99  # --set tdc.bins=99\n"));
  CHECK(has(shown, "\nbin_width_ps = 50  # " + folder.lab + ":3:1\n"));
  CHECK(has(shown, "\nwindow_s = 3.0  # default\n"));
  write_file(copy, shown);
  says("config show --config " + copy, 0, "\nbins = 99  # " + copy + ":");
}

TEST_CASE("commands refuse invalid arguments and files with an exit code and the reason") {
  // In the arguments and words, @ is the folder with a slash.
  const LabFolder folder;
  write_file(folder / "calibration.toml", "[spd]\noffset_m=1\n[response]\nirf_fwhm_ps = '0.35'\n");
  a_small_run(2).write(folder / "m1.sqlite");
  REQUIRE(::mkfifo((folder / "f.sqlite").c_str(), 0666) == 0);
  const std::string fifo = "@f.sqlite: is a FIFO; expected a regular",
                    check = "config check --config @lab.toml", set = check + " --set ",
                    run = "run --config @lab.toml --out ",
                    narrow = "irf_fwhm_ps is 0.35 ps, but the bins have 50 ps";
  std::vector<std::tuple<std::string, int, std::string>> rows{
      {check, 0, "@lab.toml: ok\n"},
      {"config check --config /dev/stdin < @lab.toml", 0, ": ok\n"},
      {set + "tdc.bins=0 --set a=1", 3, "--set tdc.bins=0: expected a whole number"},
      {set + "tdc.bins=0 --set a=1", 3, "--set a=1: unknown key"},
      {set + "'alert.on_doubt=[\"nowhere.sh\"]'", 3, "nowhere.sh: not found"},
      {"config check --config @", 3, "is a folder; expected a regular file"},
      {"config check --config /dev/zero", 3, "/dev/zero: is a device; expected a regular file"},
      {"config check --config @f.sqlite", 3, fifo},
      {set + "run.calibration=@f.sqlite", 3, fifo},
      {set + "radar.cli=serial:/x --set radar.data=serial:/y --set radar.cfg=@f.sqlite", 3, fifo},
      {set + "run.calibration=calibration.toml", 3, "/calibration.toml: " + narrow},
      {run + "@a --meta irf_fwhm_ps=0.35", 2, "--meta: " + narrow + ": is the width in ns?"},
      {run + "n\xff", 2, "--out n\\xff: expected UTF-8"},
      {"info /dev/null", 1, "/dev/null: is a device; expected a regular file"},
      {"annotate @m1 door", 0, "m1.sqlite: \"door\" noted\n"},
      {"annotate @m1 --label door", 1, "m1.sqlite: run is not being recorded"},
      {"annotate @m1 ' '", 2, "the note is empty"},
      {"annotate @m2 door", 1, "m2.sqlite: "}};
  for (const char* no_time : {"10", "2h30", "30m2h", "2h2h", "h", "''", "2h-30m", "2x", "nans"})
    rows.emplace_back(std::string("run --out a --duration ") + no_time, 2, "numbers with units");
  // Valid durations, so that only the missing file is reported.
  for (const char* time : {"2h30m", "'1h 30m 10s'", "90min", "1.5h"})
    rows.emplace_back(std::string("doctor --config no.toml --duration ") + time, 3, "no.toml");
  const std::regex at("@");
  for (const auto& [arguments, code, words] : rows)
    says(std::regex_replace(arguments, at, folder / ""), code,
         std::regex_replace(words, at, folder / ""));
}

TEST_CASE("commands exit with an error if standard output cannot be written") {
  const LabFolder folder;
  a_small_run(2).write(folder / "a.sqlite");
  for (const std::string& command : {"info " + folder / "a", "info --json " + folder / "a",
                                     "config show" + folder.config, std::string("--help")})
    CHECK_THAT(text_of(shell("(" + bin_dir + "/echofuse-acquire " + command + " > /dev/full)"), 1),
               Catch::Contains("stdout: cannot write: No space left on device"));
}

TEST_CASE("doctor and devices need no configuration file, but doctor stops if it is invalid") {
  const Folder folder;
  const std::string here = "cd " + folder / "" + " && " + bin_dir + "/echofuse-acquire ";
  const Json attached = Json::parse(text_of(shell(here + "devices --json")));
  CHECK((attached["configured"] == Json::array() && attached["attached"]["usb"].is_array()));
  const Json report = Json::parse(text_of(shell(here + "doctor --json")));
  std::string checks;
  for (const Json& check : report["checks"]) checks += check["check"].get<std::string>() + ";";
  CHECK_THAT(checks, Catch::Contains("clock;") && Catch::Contains("disk rate;") &&
                         !Catch::Contains("spd;"));
  CHECK(fs::is_empty(folder / ""));
  const LabFolder lab("[run]\nfolder = 'no'\nconnect_timeout_s = 0.2\n");
  says("doctor" + lab.config, 4, "cannot be used for a run");
}

TEST_CASE("the run command refuses a read-only folder") {
  const LabFolder folder;
  fs::create_directory(folder / "closed");
  fs::permissions(folder / "closed", fs::perms::owner_read | fs::perms::owner_exec);
  // If the test runs as root, the command drops its privileges, because root may write to a
  // read-only folder.
  const std::string as_user = geteuid() == 0 ? "setpriv --bounding-set=-all --inh-caps=-all " : "",
                    run = "/echofuse-acquire run --out " + folder / "closed/a" + folder.config;
  CHECK(has(text_of(shell(as_user + bin_dir + run), 6),
            "closed/a.sqlite: its folder is not writable: Permission denied"));
}

TEST_CASE("calibrate runs without a calibration file and never overwrites an unreadable one") {
  const LabFolder folder("[run]\nconnect_timeout_s = 0.2\ncalibration = 'c.toml'\n");
  const std::string config = "calibrate --repeat 3 --time 0.1" + folder.config;
  says(config, 4, "warning spd: " + nowhere.substr(nowhere.rfind('/') + 1) + ": ");
  says(config + " --check", 3, "lab.toml:3:1: run.calibration: " + folder / "c.toml: cannot read");
  for (const std::string text : {"[spd]\noffset_cm = 6\n", ""}) {
    write_file(folder / "c.toml", text);
    says(config, 3, "c.toml is not overwritten; remove it or set another run.calibration");
    CHECK(fs::file_size(folder / "c.toml") == text.size());
  }
  says(config + " --set run.calibration=new.toml", 4, "delivered no data within 0.2 s");
}

TEST_CASE("a run with silent devices reports each device in one line and creates no file") {
  const LabFolder folder(
      "[run]\nconnect_timeout_s = 0.3\n[radar]\ncli = 'serial:/no/cli'\ndata = 'serial:/no/data'\n"
      "cfg = 'radar/xwr68xx_paper_50cm.cfg'\n");
  const std::string said = text_of(test::acquire("run --out " + folder / "a" + folder.config), 4);
  CHECK(has(said, "\nspd " + nowhere + ": faulted: "));
  CHECK(has(said, "\nradar serial:/no/cli: faulted: "));
  CHECK_FALSE(fs::exists(folder / "a.sqlite"));
  const Json list =
      Json::parse(text_of(test::acquire("devices --json" + folder.config), 4))["configured"];
  REQUIRE(list.size() == 2);
  CHECK(list[0]["answers"] == false);
}

TEST_CASE("the info command prints the counts, labels, axes, policies and clock fits of a run") {
  const Folder folder;
  const auto add = [](record::RunWriter& run) {
    run.put_policy(Sensor::spd, "required"), run.put_policy(Sensor::depth, "optional");
    run.put_device({Sensor::radar, "serial:/x", "M", "7", "3.5", {}});
    const record::CounterRow counted[] = {
        {"spd", "tags", 9}, {"spd", "bytes", 2'500'000}, {"spd", "late", 0}};
    run.put_counters(counted);
  };
  const auto change = [](FusedRecord& r) {
    if (r.index == 1) r.missing = SensorSet::from_bits(5);
    if (r.index == 1) r.clocks[Sensor::depth] = record::ClockState{-7, 20, 2e-3, 64};
    const auto samples = static_cast<std::uint64_t>(97 + r.index);
    r.clocks[Sensor::spd] = record::ClockState{1.5, -3, 1e-4, samples};
  };
  RunBuilder made = a_small_run(6).zones(Zones(2)).offset(Sensor::spd, 0.31, 5e-4);
  const std::string run = made.begin(add).each(change).write(folder / "a.sqlite");
  const std::string text = text_of(test::acquire("info " + run));
  for (const char* words :
       {"6 records, complete",
        "slots     2023-11-14T22:13:20.000Z to 2023-11-14T22:13:20.000Z, 0.2 s each",
        "valid     spd 6, radar 6, depth 6; all three sensors 6", "verdicts  spd: ok 6",
        "policy    depth optional, spd required; incomplete 1",
        "clock     spd: offset 1.5 s, drift -3 ppm, residual 100 µs, 102 samples",
        "lost      spd 0, radar 6, depth 12; tags 6015", "counted   spd: tags 9, bytes 2.5 MB\n",
        "axis      spd: 8 x 100 ps from 13343 ps, counts", "axis      depth_x: 3 x 0.2 from -0.2",
        "zones     2, clicks 12168 12552; directions unknown", "labels    letter:A 3, person 3",
        "clock     depth: offset -7 s, drift 20 ppm", "offset    spd: 310.00 ± 0.50 mm, of ",
        "device    radar: M 7 at serial:/x", "notes     a test"})
    CHECK_THAT(text, Catch::Contains(words));
  CHECK_FALSE(has(text, "clock     radar"));  // no record contains a fit of this clock
}

TEST_CASE("a run is found without its extension, and a name that is not UTF-8 is escaped in JSON") {
  const Folder folder;
  const std::string name = folder / "m\xff.sqlite", shown = folder / "m\\xff.sqlite";
  a_small_run(1).write(name);
  CHECK(json_of("info --json " + name)["file"] == shown);
  CHECK(json_of("list --json " + folder / "")["runs"][0]["path"] == shown);
  a_small_run(2).write(folder / "m1.sqlite");
  a_small_run(3).write(folder / "plain");
  CHECK(json_of("info --json " + folder / "m1")["records"] == 2);
  CHECK(json_of("info --json " + folder / "plain")["records"] == 3);
}

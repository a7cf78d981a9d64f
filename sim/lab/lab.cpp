// SPDX-License-Identifier: MIT
#include "sim/lab/lab.hpp"

#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "drivers/util/console.hpp"
#include "drivers/util/lock.hpp"
#include "drivers/util/new_file.hpp"
#include "drivers/util/program.hpp"
#include "drivers/util/settings.hpp"
#include "sim/devices/listener.hpp"
#include "sim/sensors/optics.hpp"

namespace echofuse::sim {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr char first_line[] = "# echofuse-sim lab";
constexpr char module_name[] = "libechofuse_sim_depth.so";
// Files of a laboratory in its directory. Transient files are removed when the laboratory closes;
// lasting files remain.
const char* const transient[] = {"radar-cli",      "radar-data", "radar-cli.new",
                                 "radar-data.new", "depth.sock", "openni"};
const char* const lasting[] = {"lab.toml", "radar.cfg", "sent.json"};
constexpr char lock_name[] = "lab.lock";  // file that exists while a laboratory is running

// Returns true for a partially written file left behind by a laboratory that was killed.
bool is_unfinished(const std::string& name) {
  return name.ends_with(".part") &&
         std::any_of(std::begin(lasting), std::end(lasting),
                     [&](const std::string& file) { return name.starts_with(file + "."); });
}

bool is_ours(const fs::path& dir) {
  if (const fs::path former = dir / "lab.toml"; fs::exists(former))
    if (read_config_text(former).starts_with(first_line)) return true;
  const auto own = [](const std::string& name) {
    return is_unfinished(name) || name == lock_name ||
           std::find(std::begin(transient), std::end(transient), name) != std::end(transient) ||
           std::find(std::begin(lasting), std::end(lasting), name) != std::end(lasting);
  };
  return std::all_of(fs::directory_iterator(dir), {}, [&](const fs::directory_entry& entry) {
    return own(entry.path().filename().string());
  });
}

fs::path make_directory(const std::string& expected) {
  std::error_code error;
  fs::create_directories(expected, error);
  if (!fs::is_directory(expected))
    throw Error(ExitCode::usage, expected + ": cannot create the directory: " + error.message());
  const fs::path dir = fs::canonical(expected);
  const std::string socket = (dir / "depth.sock").string();
  if (socket.size() >= sizeof(sockaddr_un::sun_path))
    throw Error(ExitCode::usage, dir.string() + ": the path is too long for a socket (" +
                                     std::to_string(socket.size()) + " bytes, at most " +
                                     std::to_string(sizeof(sockaddr_un::sun_path) - 1) +
                                     "); use a shorter --dir");
  if (!is_ours(dir))
    throw Error(
        ExitCode::usage,
        dir.string() +
            ": contains files that do not belong to a laboratory; expected an empty directory "
            "or the directory of an earlier laboratory");
  return dir;
}

fs::path find_radar_cfg(const LabOptions& options) {
  if (!options.radar_cfg.empty()) return here_or_installed(options.radar_cfg);
  const std::string name = options.radar_board == "isk"
                               ? "xwr68xx_paper_50cm"
                               : "xwr64xx_" + options.radar_board + "_50cm";
  return data_folder() / ("radar/" + name + ".cfg");
}

// Folder of the OpenNI2 library found by the build.
const fs::path openni_folder = ECHOFUSE_OPENNI2_DIR;

// Creates a private copy of OpenNI2: links to the library and to its file driver, and a copy of the
// simulator's driver module. OpenNI2 loads drivers only from a folder next to its library, so
// adding a driver to an installed OpenNI2 requires root rights. The driver module is copied, so
// that a rebuild does not change it during use.
void make_openni(const fs::path& dir) {
  const fs::path drivers = dir / "openni/OpenNI2/Drivers";
  const fs::path library = openni_folder / "libOpenNI2.so.0";
  if (!fs::exists(library))
    throw Error(ExitCode::failed,
                library.string() + ": file not found; the simulated depth camera needs OpenNI2");
  fs::create_directories(drivers);
  fs::create_symlink(library, dir / "openni/libOpenNI2.so.0");
  fs::create_symlink(openni_folder / "OpenNI2/Drivers/libOniFile.so.0",
                     drivers / "libOniFile.so.0");
  const fs::path module = program_folder() / ECHOFUSE_LIBDIR / module_name;
  std::error_code error;
  fs::copy_file(module, drivers / (std::string(module_name) + ".0"), error);
  if (error)
    throw Error(ExitCode::failed,
                module.string() + ": cannot copy the OpenNI2 driver module: " + error.message());
}

std::int64_t whole_ps(const char* key, double value) {
  if (value != std::floor(value))
    throw Error(ExitCode::config, std::string(key) + " = " + std::to_string(value) +
                                      ": the daemon accepts only whole picoseconds");
  return static_cast<std::int64_t>(value);
}

std::string shell_word(const std::string& word) {
  const bool plain = std::all_of(word.begin(), word.end(), [](unsigned char c) {
    return std::isalnum(c) || std::strchr("/._-+", c);
  });
  if (plain) return word;
  std::string quoted = "'";
  for (const char c : word) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

std::string detector_lines(const Conditions& conditions) {
  const record::Detector detector = stated_detector(conditions);
  if (!detector.known()) return "";
  return std::isinf(detector.dead_time_ps)
             ? "\nfirst_photon_only = true"
             : "\ndetector_dead_time_ps = " + Json(detector.dead_time_ps).dump();
}

// Returns the text of lab.toml. `label` is the label of the scene; it is empty if the scene
// changes.
std::string lab_toml(const LabOptions& o, const fs::path& dir, const std::string& tdc_address,
                     const std::string& label) {
  const record::MapGrid map = map_grid(o.conditions);
  std::ostringstream out;
  out << first_line
      << ": simulated devices; start the daemon with LD_LIBRARY_PATH=" << (dir / "openni").string()
      << "\n[run]\nwindow_s = " << Json(o.window_s).dump() << "\nlabel = " << in_quotes(label)
      << "\n\n[tdc]\naddress = " << in_quotes(tdc_address)
      << "\nstart_channel = " << o.tagging.sync_channel
      << "\nclick_channel = " << o.tagging.click_channel
      << "\nbin_width_ps = " << whole_ps("bin_width_ps", o.conditions.bin_width_ps)
      << "\nfirst_bin_ps = " << whole_ps("first_bin_ps", o.conditions.first_bin_ps)
      << "\nbins = " << o.conditions.bins << detector_lines(o.conditions)
      << "\n\n[radar]\ncli = " << in_quotes("serial:" + (dir / "radar-cli").string())
      << "\ndata = " << in_quotes("serial:" + (dir / "radar-data").string())
      << "\ncfg = \"radar.cfg\"\nboard = " << in_quotes(o.radar_board)
      << "\nbaseline_m = " << Json(o.conditions.baseline_m).dump()
      << "\n\n[depth]\naddress = \"openni:\"\nmap_size = " << map.size
      << "\nmap_half_tangent = " << Json(map.half_tangent).dump()
      << "\nmap_z_max_m = " << Json(map.far_m).dump() << "\n";
  return out.str();
}

LabTagger bridged_tagger(port::SystemLoop& loop, ScenePlayer& player, const TdcOptions& options) {
  auto listener = make_tcp_listener(loop, 0);
  std::string address = listener->address();
  const auto make =
      player.conditions().sends_histograms() ? make_histogram_bridge : make_tdc_bridge;
  return {make(loop, player, options, std::move(listener)), std::move(address)};
}

}  // namespace

struct Lab::Impl {
  Impl(port::SystemLoop& l, const LabOptions& o)
      : options(o),
        dir(make_directory(o.dir)),
        lock(dir / lock_name, 0600),
        loop(l),
        player(loop, o.conditions, o.schedule) {
    if (!lock.held())
      throw Error(ExitCode::usage,
                  dir.string() + ": another laboratory is running in this directory");
    if (!o.faults.empty()) plan.faults = read_faults(read_config_text(o.faults), o.faults);
    if (o.log.empty()) return;
    refuse_run_or_model(o.log);
    plan.sent_log = &sent_log.emplace(o.log);
  }

  ~Impl() {
    remove(std::begin(transient), std::end(transient));
    lock.remove();
  }

  void remove(const char* const* first, const char* const* last) const {
    std::error_code ignored;
    for (; first != last; ++first) fs::remove_all(dir / *first, ignored);
  }

  void start() {
    const std::string cfg = read_config_text(find_radar_cfg(options));
    remove(std::begin(transient), std::end(transient));
    remove(std::begin(lasting), std::end(lasting));
    const std::string label = options.schedule.hold_s > 0 ? "" : player.at(0).scene.label;
    const auto seed = static_cast<std::uint64_t>(options.schedule.seed);
    tagger = (options.make_tagger ? options.make_tagger : bridged_tagger)(
        loop, player,
        {.tagging = options.tagging, .window_s = options.window_s, .seed = seed, .plan = plan});
    radar =
        make_radar_ptys(loop, player,
                        {.cli_link = (dir / "radar-cli").string(),
                         .data_link = (dir / "radar-data").string(),
                         .seed = seed,
                         .plan = plan,
                         .sdk = find_radar_cfg(options).string().ends_with("_sdk3.4.cfg") ? 4U : 5U,
                         .board = options.radar_board});
    depth = make_depth_feed(
        loop, player, {.socket_path = (dir / "depth.sock").string(), .seed = seed, .plan = plan});
    make_openni(dir);
    write_atomically(dir / "radar.cfg", cfg);
    write_atomically(dir / "lab.toml", lab_toml(options, dir, tagger.address, label));
  }

  LabOptions options;
  fs::path dir;
  Lock lock;
  port::SystemLoop& loop;
  ScenePlayer player;
  FaultPlan plan;
  std::optional<SentLog> sent_log;
  LabTagger tagger;
  std::unique_ptr<Device> radar, depth;
};

Lab::Lab(port::SystemLoop& loop, const LabOptions& options)
    : parts_(std::make_unique<Impl>(loop, options)) {
  parts_->start();
}

Lab::~Lab() = default;

std::string Lab::daemon_command() const {
  return "LD_LIBRARY_PATH=" + shell_word((parts_->dir / "openni").string()) + " " +
         shell_word((program_folder() / "echofuse-acquire").string()) + " run --config " +
         shell_word((parts_->dir / "lab.toml").string()) + " --out run.sqlite";
}

std::vector<std::pair<std::string, std::string>> Lab::environment() const {
  auto all = parts_->tagger.environment;
  all.emplace_back("LD_LIBRARY_PATH", (parts_->dir / "openni").string());
  return all;
}

void Lab::serve(const std::function<bool()>& done) {
  constexpr auto patience = std::chrono::seconds(1);
  parts_->loop.run_until(done);
  for (Device* device : {parts_->tagger.device.get(), parts_->radar.get(), parts_->depth.get()})
    device->stop();
  parts_->loop.run_for(patience);
  parts_->remove(std::begin(transient), std::end(transient));
  write_atomically(parts_->dir / "sent.json", sent() + "\n");
  if (parts_->sent_log) parts_->sent_log->close();
}

std::string Lab::sent() const {
  const auto& p = *parts_;
  Json all;
  all["play"] = {{"scene", p.options.schedule.kind},
                 {"seed", p.options.schedule.seed},
                 {"hold_s", p.options.schedule.hold_s},
                 {"window_s", p.options.window_s},
                 {"start_mono_ns", p.player.start().count()}};
  const auto add = [&](const char* name, const Device& device) {
    for (const auto& [what, count] : device.sent()) all[name][what] = count;
  };
  add("tdc", *p.tagger.device);
  add("radar", *p.radar);
  add("depth", *p.depth);
  return all.dump();
}

ExitCode serve_command(Lab& lab, const std::vector<std::string>& command, bool quiet) {
  const bool talks = !quiet && ::isatty(STDERR_FILENO) != 0;
  for (const auto& [name, value] : lab.environment()) ::setenv(name.c_str(), value.c_str(), 1);
  const char* path = std::getenv("PATH");
  ::setenv("PATH", (program_folder().string() + (path ? std::string(":") + path : "")).c_str(), 1);
  const auto started = start_program(command);
  if (!started) throw Error(ExitCode::failed, started.failure().text());
  const pid_t child = *started;
  if (talks)
    std::fprintf(
        stderr,
        "the laboratory is open; the addresses of its devices are in lab.toml. Running `%s`; the "
        "laboratory closes when this command exits\n",
        command.front().c_str());
  int status = 0;
  bool signalled = false;
  lab.serve([&] {
    if (interrupted() && !std::exchange(signalled, true)) ::kill(child, SIGTERM);
    return ::waitpid(child, &status, WNOHANG) != 0;
  });
  if (talks) std::fputs("the laboratory is closed\n", stderr);
  return static_cast<ExitCode>(WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status));
}

}  // namespace echofuse::sim

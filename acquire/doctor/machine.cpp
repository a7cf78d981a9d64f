// SPDX-License-Identifier: MIT
#include <sys/resource.h>
#include <sys/timex.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "acquire/devices/device_locks.hpp"
#include "acquire/doctor/doctor.hpp"
#include "drivers/port/open_port.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/program.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::acquire {
namespace {

namespace fs = std::filesystem;

constexpr const char* rules = "70-echofuse.rules";
constexpr const char* install_rules =
    "install config/70-echofuse.rules as described in its header, and join the groups dialout, "
    "plugdev and video";
constexpr const char* check_groups =
    "replug the device; check that this user is in the groups dialout, plugdev and video";
constexpr const char* check_plug =
    "check the cable and the configured name of the device; `devices` lists attached devices";

std::string text_of(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

// Returns the device node of a serial port address; empty for any other address.
std::string serial_path(const std::string& address) {
  constexpr std::string_view kind = "serial:";
  if (!address.starts_with(kind)) return {};
  std::error_code error;
  const fs::path path = address.substr(kind.size());
  const fs::path real = fs::canonical(path, error);
  return (error ? path : real).string();
}

struct Port {
  std::string path, missing;
  bool configured = false;
  bool denied = false;  // true if the node exists but this user has no permission to open it
};

bool is_denied(const std::string& path) {
  return ::access(path.c_str(), R_OK | W_OK) != 0 && (errno == EACCES || errno == EPERM);
}

std::vector<Port> ports(const std::optional<Config>& config, const MachineRoots& roots) {
  std::vector<std::string> expected;
  std::vector<Port> out;
  if (config)
    for (const Sensor s : all_sensors)
      for (const std::string& address : addresses_of(*config, s)) expected.push_back(address);
  for (const std::string& address : expected) {
    const std::string path = serial_path(address);
    if (path.empty()) continue;
    const bool usable = ::access(path.c_str(), R_OK | W_OK) == 0;
    out.push_back({path, usable ? "" : path + ": " + std::strerror(errno), true, is_denied(path)});
  }
  const auto is_expected = [&](const inventory::Node& node) {
    return !node.address.empty() &&
           std::find(expected.begin(), expected.end(), node.address) != expected.end();
  };
  for (const auto& device : inventory::list_attached(roots.devices))
    for (const auto& node : device.nodes) {
      const auto known =
          std::find_if(out.begin(), out.end(), [&](auto& p) { return p.path == node.path; });
      if (known == out.end())
        out.push_back({node.path, node.missing, is_expected(node), is_denied(node.path)});
      else
        known->missing = node.missing;
    }
  return out;
}

bool rules_installed(const MachineRoots& roots) {
  std::error_code error;
  return fs::exists(fs::path(roots.etc) / "udev/rules.d" / rules, error) ||
         fs::exists(fs::path(roots.lib) / "udev/rules.d" / rules, error);
}

bool modem_manager_runs(const MachineRoots& roots) {
  for (const auto& process : entries_of(roots.proc))
    if (text_of(process / "comm") == "ModemManager\n") return true;
  return false;
}

// Returns true if udev's database instructs ModemManager to ignore /dev/NAME.
bool ignored_by_modem_manager(const std::string& name, const MachineRoots& roots) {
  std::string numbers = text_of(fs::path(roots.devices.sys) / "class/tty" / name / "dev");
  std::erase(numbers, '\n');
  const std::string entry = text_of(fs::path(roots.run) / "udev/data" / ("c" + numbers));
  return entry.find("E:ID_MM_DEVICE_IGNORE=1\n") != entry.npos;
}

}  // namespace

std::vector<Finding> check_permissions(const std::optional<Config>& config,
                                       const MachineRoots& roots) {
  constexpr const char* check = "permissions";
  std::vector<Finding> out;
  const auto all = ports(config, roots);
  for (const Port& port : all)
    if (!port.missing.empty())
      out.push_back({check, port.configured ? Grade::problem : Grade::warning,
                     port.denied ? "no read/write permission on " + port.path : port.missing,
                     port.path.empty()        ? ""
                     : !port.denied           ? check_plug
                     : rules_installed(roots) ? check_groups
                                              : install_rules});
  const double count = static_cast<double>(all.size());
  if (out.empty())
    out.push_back({check,
                   Grade::ok,
                   all.empty() ? "no device node to check"
                               : std::to_string(all.size()) + " device nodes can be opened",
                   "",
                   {{"nodes", count}}});
  const bool installed = rules_installed(roots);
  for (const Finding& finding : out)
    // The finding already contains the advice to install the udev rules.
    if (finding.advice == install_rules) return out;
  const bool fine = installed || inventory::list_attached(roots.devices).empty();
  out.push_back({"udev rules", fine ? Grade::ok : Grade::warning,
                 std::string(rules) + (installed ? " is installed"
                                       : fine ? " is not installed, and no attached device needs it"
                                              : " is not installed"),
                 fine ? "" : install_rules});
  return out;
}

Finding check_modem_manager(const std::optional<Config>& config, const MachineRoots& roots) {
  constexpr const char* check = "ModemManager";
  if (!modem_manager_runs(roots)) return {check, Grade::ok, "not running"};
  std::string grabbed;
  for (const Port& port : ports(config, roots)) {
    const std::string name = fs::path(port.path).filename().string();
    if (name.starts_with("ttyACM") || name.starts_with("ttyUSB"))
      if (!ignored_by_modem_manager(name, roots)) grabbed += " " + port.path;
  }
  if (grabbed.empty())
    return {check, Grade::ok, "running, but ignores the serial ports of the radar"};
  return {check, Grade::warning, "running, and probes" + grabbed + " when the device is plugged in",
          install_rules};
}

Finding check_usb_memory(const std::optional<Config>& config, const MachineRoots& roots) {
  constexpr const char* check = "USB memory";
  constexpr const char* file = "module/usbcore/parameters/usbfs_memory_mb";
  const bool ring = config && config->tdc.address.starts_with("usb:");
  const double needed = ring ? static_cast<double>(port::usb_ring_bytes) / (1 << 20) : 0;
  const std::string text = text_of(fs::path(roots.devices.sys) / file);
  double limit = 0;
  if (std::sscanf(text.c_str(), "%lf", &limit) != 1) {
    if (!ring) return {check, Grade::ok, "no USB time tagger is configured"};
    return {check, Grade::warning, "limit unknown", "check that the module usbcore is loaded"};
  }
  const std::string found =
      format("usbfs_memory_mb is %g%s; the time tagger's ring buffer needs %g MiB", limit,
             limit == 0 ? " (no limit)" : "", needed);
  const bool enough = limit == 0 || limit >= needed;
  return {check,
          enough ? Grade::ok : Grade::problem,
          found,
          enough ? "" : "run as root: echo 16 > /sys/module/usbcore/parameters/usbfs_memory_mb",
          {{"limit_mib", limit}, {"needed_mib", needed}}};
}

Finding check_usb_power(const std::optional<Config>& config, const MachineRoots& roots) {
  constexpr const char* check = "USB power";
  std::string found, files;
  for (const Port& port : ports(config, roots))
    if (const auto file = inventory::suspension_switch(port.path, roots.devices); !file.empty()) {
      found += (found.empty() ? "" : ", ") + port.path;
      if (files.find(file) == files.npos) files += " " + file;
    }
  if (found.empty()) return {check, Grade::ok, "no device may be suspended"};
  return {check, Grade::warning, found + " may be suspended while idle",
          "install config/70-echofuse.rules and replug the device, or run as root: echo on | tee" +
              files};
}

Finding check_open_files(std::uint64_t limit) {
  constexpr std::uint64_t enough = 64;
  const double files = static_cast<double>(limit);
  if (limit >= enough)
    return {"open files", Grade::ok, "limit is sufficient", "", {{"limit", files}}};
  return {"open files",
          Grade::warning,
          "at most " + std::to_string(limit) + " files (expected at least " +
              std::to_string(enough) + ")",
          "raise the limit (ulimit -n 1024; LimitNOFILE= in a service unit), or a run may end when "
          "it begins a new file",
          {{"limit", files}}};
}

std::uint64_t open_files_limit() {
  rlimit limit{};
  return ::getrlimit(RLIMIT_NOFILE, &limit) == 0 ? limit.rlim_cur : RLIM_INFINITY;
}

Finding processor_finding() {
  return {"processor", Grade::ok,
          instruction_set() + ", " + std::to_string(usable_cores()) + " usable cores"};
}

KernelClock read_clock() {
  timex state{};
  const int answer = ::adjtimex(&state);  // only reads the clock, because state.modes is 0
  return {answer >= 0, answer >= 0 && answer != TIME_ERROR && !(state.status & STA_UNSYNC),
          static_cast<double>(state.maxerror) * 1e-6};
}

Finding check_clock(const KernelClock& clock) {
  constexpr const char* check = "clock";
  constexpr double enough_s = 0.1;
  if (!clock.readable) return {check, Grade::warning, "synchronisation unknown", ""};
  const std::string found =
      format("%s, maximum error %.4g s", clock.synchronised ? "synchronised" : "not synchronised",
             clock.maximal_error_s);
  const bool good = clock.synchronised && clock.maximal_error_s <= enough_s;
  return {
      check,
      good ? Grade::ok : Grade::warning,
      found,
      good ? ""
           : "start chrony or systemd-timesyncd; slots keep their length without it, but the UTC "
             "times of the records have this error",
      {{"synchronised", clock.synchronised ? 1.0 : 0.0},
       {"maximal_error_s", clock.maximal_error_s}}};
}

}  // namespace echofuse::acquire

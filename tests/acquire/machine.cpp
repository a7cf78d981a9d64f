// SPDX-License-Identifier: MIT
// Tests the checks of the machine by doctor, on test folders laid out like those of the kernel and
// udev.
#include <unistd.h>

#include "captured.hpp"
#include "testing.hpp"

using namespace echofuse::acquire;

namespace {

class Machine {
 public:
  MachineRoots roots() const {
    return {{folder_ / "sys", folder_ / "dev"},
            folder_ / "proc",
            folder_ / "run",
            folder_ / "etc",
            folder_ / "lib"};
  }
  std::string operator/(const std::string& name) const { return folder_ / name; }
  void write(const std::string& name, const std::string& text) {
    fs::create_directories(fs::path(folder_ / name).parent_path());
    write_file(folder_ / name, text);
  }
  // Adds a radar board with the serial ports /dev/ttyACM0 and /dev/ttyACM1.
  void plug_in_radar() {
    const std::string place = "sys/bus/usb/devices/1-2/";
    write(place + "idVendor", "0451\n");
    write(place + "idProduct", "bef3\n");
    for (const std::string n : {"0", "3"}) {
      const std::string name = n == "0" ? "ttyACM0" : "ttyACM1";
      write(place + "1-2:1." + n + "/bInterfaceNumber", "0" + n + "\n");
      write(place + "1-2:1." + n + "/tty/" + name + "/dev", "");
      write("sys/class/tty/" + name + "/dev", "166:" + n + "\n");
      write("dev/" + name, "");
    }
  }
  // Checks the only finding of check_permissions() with this name.
  void check(const std::string& name, Grade grade, const std::string& words,
             const std::optional<Config>& config = {}) const {
    auto findings = check_permissions(config, roots());
    std::erase_if(findings, [&](const Finding& f) { return f.check != name; });
    REQUIRE(findings.size() == 1);
    check_finding(findings[0], grade, words);
  }

 private:
  Folder folder_;
};

Config with_radar(const std::string& cli) {
  Config config;
  config.radar.cli = "serial:" + cli;
  return config;
}

}  // namespace

TEST_CASE("the doctor command reports no problem on a machine without devices") {
  const Machine machine;
  CHECK(check_permissions({}, machine.roots()).size() == 2);
  machine.check("permissions", Grade::ok, "no device node to check");
  machine.check("udev rules", Grade::ok, "is not installed, and no attached device needs it");
  check_finding(check_modem_manager({}, machine.roots()), Grade::ok, "not running");
  check_finding(check_usb_memory({}, machine.roots()), Grade::ok);
}

TEST_CASE("the doctor command accepts accessible device nodes and reports missing udev rules") {
  Machine machine;
  machine.plug_in_radar();
  machine.check("permissions", Grade::ok, "2 device nodes can be opened");
  machine.check("udev rules", Grade::warning, "config/70-echofuse.rules");
  const std::string place = GENERATE("etc", "lib");
  machine.write(place + "/udev/rules.d/70-echofuse.rules", "");
  machine.check("udev rules", Grade::ok, "is installed");
}

TEST_CASE("doctor rates a missing device node as a problem only if the device is configured") {
  Machine machine;
  const std::string gone = machine / "dev/ttyACM0";
  // A radar port of an unknown vendor. A missing device is not a permission problem.
  machine.check("permissions", Grade::problem,
                gone + ": No such file or directory; check the cable and the configured name",
                with_radar(gone));
  machine.plug_in_radar();
  fs::remove(gone);
  machine.check("permissions", Grade::warning, "check the cable and the configured name");
  machine.check("permissions", Grade::warning, "", with_radar(machine / "dev/ttyACM1"));
  machine.check("permissions", Grade::problem, "", with_radar(gone));
}

TEST_CASE("the doctor command names devices that the kernel may suspend") {
  Machine machine;
  machine.plug_in_radar();
  machine.write("dev/ttyS7", "");
  const std::string place = "sys/bus/usb/devices/1-2/", radar = machine / "dev/ttyACM0";
  const auto check = [&](Grade grade, const std::string& words) {
    check_finding(check_usb_power(with_radar(machine / "dev/ttyS7"), machine.roots()), grade,
                  words);
  };
  check(Grade::ok, "no device may be suspended");
  machine.write(place + "power/control", "on\n");
  check(Grade::ok, "no device may be suspended");
  machine.write(place + "power/control", "auto\n");
  check(Grade::warning, radar + ", " + machine / "dev/ttyACM1" + " may be suspended while idle");
  check(Grade::warning, "echo on | tee " + machine / (place + "power/control"));
  machine.write(place + "idVendor", "0403\n");  // not a kind that echofuse supports
  check(Grade::ok, "");
  check_finding(check_usb_power(with_radar(radar), machine.roots()), Grade::warning,
                radar + " may");
}

TEST_CASE("the doctor command warns of a limit below 64 open files") {
  check_finding(check_open_files(64), Grade::ok);
  check_finding(check_open_files(63), Grade::warning, "at most 63 files (expected at least 64)");
}

TEST_CASE("doctor names the missing udev rule or group for an inaccessible device node") {
  if (::geteuid() == 0) return;  // root may open any file, so the remaining checks would fail
  Machine machine;
  machine.plug_in_radar();
  fs::permissions(machine / "dev/ttyACM0", fs::perms::none);
  machine.check("permissions", Grade::warning, "install config/70-echofuse.rules");
  // The missing udev rules are already reported by the finding "permissions", so they are not
  // reported twice.
  CHECK(check_permissions({}, machine.roots()).size() == 1);
  machine.write("etc/udev/rules.d/70-echofuse.rules", "");
  machine.check("permissions", Grade::warning, "check that this user is in the groups dialout");
}

TEST_CASE("the doctor command warns of ModemManager unless udev rules exclude the port") {
  Machine machine;
  machine.plug_in_radar();
  const auto check = [&](Grade grade, const std::string& words) {
    check_finding(check_modem_manager({}, machine.roots()), grade, words);
  };
  check(Grade::ok, "not running");
  machine.write("proc/41/comm", "init\n");
  machine.write("proc/42/comm", "ModemManager\n");
  const std::string probes = "running, and probes ", second = machine / "dev/ttyACM1 when";
  check(Grade::warning, probes + machine / "dev/ttyACM0 " + second);
  machine.write("run/udev/data/c166:0", "S:serial/by-id/x\nE:ID_MM_DEVICE_IGNORE=1\n");
  check(Grade::warning, probes + second);
  machine.write("run/udev/data/c166:3", "E:ID_MM_DEVICE_IGNORE=1\n");
  check(Grade::ok, "running, but ignores the serial ports of the radar");
}

TEST_CASE("doctor compares the kernel's USB memory limit with the buffer of the time tagger") {
  Machine machine;
  Config config;
  config.tdc.address = "usb:1209:0001";
  const auto check = [&](Grade grade, const std::string& words) {
    check_finding(check_usb_memory(config, machine.roots()), grade, words);
  };
  check(Grade::warning, "limit unknown");
  for (const auto& [limit, grade, words] :
       {std::tuple("16", Grade::ok, "is 16; the time tagger's ring buffer needs 2 MiB"),
        {"0", Grade::ok, "is 0 (no limit)"},
        {"2", Grade::ok, ""},
        {"1", Grade::problem, "usbfs_memory_mb"}}) {
    machine.write("sys/module/usbcore/parameters/usbfs_memory_mb", std::string(limit) + "\n");
    check(grade, words);
  }
  config.tdc.address = "bridge:tcp://h:1";
  check(Grade::ok, "");
}

TEST_CASE("the doctor command reports whether the system clock is synchronised") {
  check_finding(check_clock({true, true, 0.1}), Grade::ok);
  check_finding(check_clock({true, true, 0.11}), Grade::warning);
  check_finding(check_clock({true, false, 16}), Grade::warning, "not synchronised, maximum error");
  check_finding(check_clock({}), Grade::warning, "synchronisation unknown");
  CHECK(read_clock().readable);
}

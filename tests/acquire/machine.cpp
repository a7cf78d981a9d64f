// SPDX-License-Identifier: MIT
// Tests the checks of the machine by doctor, on test folders laid out like those of the kernel and
// udev.
#include <unistd.h>

#include "acquire/doctor/doctor.hpp"
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
  void start_modem_manager() {
    write("proc/41/comm", "init\n");
    write("proc/42/comm", "ModemManager\n");
  }

 private:
  Folder folder_;
};

Config with_radar(const std::string& cli) {
  Config config;
  config.radar.cli = cli;
  return config;
}

const Finding& of(const std::vector<Finding>& findings, const std::string& check) {
  for (const Finding& finding : findings)
    if (finding.check == check) return finding;
  throw std::runtime_error("no finding about " + check);
}

}  // namespace

TEST_CASE("the doctor command reports no problem on a machine without devices") {
  const Machine machine;
  const auto findings = check_permissions(std::nullopt, machine.roots());
  CHECK(findings.size() == 2);
  CHECK(of(findings, "permissions").grade == Grade::ok);
  CHECK(of(findings, "udev rules").grade == Grade::ok);
  CHECK(check_modem_manager(std::nullopt, machine.roots()).found == "not running");
  CHECK(check_usb_memory(std::nullopt, machine.roots()).grade == Grade::ok);
}

TEST_CASE("the doctor command accepts accessible device nodes and reports missing udev rules") {
  Machine machine;
  machine.plug_in_radar();
  auto findings = check_permissions(std::nullopt, machine.roots());
  CHECK(of(findings, "permissions").found == "2 device nodes can be opened");
  CHECK(of(findings, "udev rules").grade == Grade::warning);
  CHECK(has(of(findings, "udev rules").advice, "config/70-echofuse.rules"));
  const std::string place = GENERATE("etc", "lib");
  machine.write(place + "/udev/rules.d/70-echofuse.rules", "");
  findings = check_permissions(std::nullopt, machine.roots());
  CHECK(of(findings, "udev rules").grade == Grade::ok);
}

TEST_CASE("doctor rates a missing device node as a problem only if the device is configured") {
  Machine machine;
  machine.plug_in_radar();
  fs::remove(machine / "dev/ttyACM0");
  const auto grade = [&](const std::optional<Config>& config) {
    return of(check_permissions(config, machine.roots()), "permissions").grade;
  };
  CHECK(grade(std::nullopt) == Grade::warning);
  CHECK(grade(with_radar("serial:" + machine / "dev/ttyACM1")) == Grade::warning);
  CHECK(grade(with_radar("serial:" + machine / "dev/ttyACM0")) == Grade::problem);
}

TEST_CASE("the doctor command names devices that the kernel may suspend") {
  Machine machine;
  machine.plug_in_radar();
  machine.write("dev/ttyS7", "");
  const auto finding = [&] {
    return check_usb_power(with_radar("serial:" + machine / "dev/ttyS7"), machine.roots());
  };
  CHECK(finding().grade == Grade::ok);
  const std::string control = "sys/bus/usb/devices/1-2/power/control";
  machine.write(control, "on\n");
  CHECK(finding().grade == Grade::ok);
  machine.write(control, "auto\n");
  CHECK(finding().grade == Grade::warning);
  CHECK(has(finding().found, machine / "dev/ttyACM0"));
  CHECK(has(finding().found, machine / "dev/ttyACM1"));
  CHECK_FALSE(has(finding().found, "ttyS7"));
  CHECK(has(finding().advice, "echo on | tee " + machine / control));
  machine.write("sys/bus/usb/devices/1-2/idVendor", "0403\n");  // not a kind that echofuse supports
  CHECK(finding().grade == Grade::ok);
  const auto configured = with_radar("serial:" + machine / "dev/ttyACM0");
  CHECK(check_usb_power(configured, machine.roots()).grade == Grade::warning);
}

TEST_CASE("the doctor command warns of a limit below 64 open files") {
  CHECK(check_open_files(64).grade == Grade::ok);
  CHECK(check_open_files(63).grade == Grade::warning);
  CHECK(has(check_open_files(16).found, "at most 16 files (expected at least 64)"));
}

TEST_CASE("the doctor command checks a configured radar port of an unknown vendor") {
  const Machine machine;
  const auto findings =
      check_permissions(with_radar("serial:" + machine / "dev/ttyS7"), machine.roots());
  CHECK(of(findings, "permissions").grade == Grade::problem);
  CHECK(has(of(findings, "permissions").found, "dev/ttyS7: No such file or directory"));
  // A missing device is not a permission problem.
  CHECK(has(of(findings, "permissions").advice, "check the cable and the configured name"));
  CHECK_FALSE(has(of(findings, "permissions").advice, "rules"));
}

TEST_CASE("doctor names the missing udev rule or group for an inaccessible device node") {
  if (::geteuid() == 0) return;  // root may open any file, so the remaining checks would fail
  Machine machine;
  machine.plug_in_radar();
  fs::permissions(machine / "dev/ttyACM0", fs::perms::none);
  const auto advice = [&] {
    return of(check_permissions(std::nullopt, machine.roots()), "permissions").advice;
  };
  CHECK(has(advice(), "install config/70-echofuse.rules"));
  // The missing udev rules are already reported by the finding "permissions", so they are not
  // reported twice.
  for (const auto& finding : check_permissions(std::nullopt, machine.roots()))
    CHECK(finding.check != "udev rules");
  machine.write("etc/udev/rules.d/70-echofuse.rules", "");
  CHECK(has(advice(), "check that this user is in the groups dialout"));
}

TEST_CASE("the doctor command warns of ModemManager unless udev rules exclude the port") {
  Machine machine;
  machine.plug_in_radar();
  CHECK(check_modem_manager(std::nullopt, machine.roots()).grade == Grade::ok);
  machine.start_modem_manager();
  const auto found = check_modem_manager(std::nullopt, machine.roots());
  CHECK(found.grade == Grade::warning);
  CHECK(has(found.found, machine / "dev/ttyACM0 " + machine / "dev/ttyACM1"));
  machine.write("run/udev/data/c166:0", "S:serial/by-id/x\nE:ID_MM_DEVICE_IGNORE=1\n");
  const auto half = check_modem_manager(std::nullopt, machine.roots());
  CHECK(half.grade == Grade::warning);
  CHECK_FALSE(has(half.found, "ttyACM0"));
  machine.write("run/udev/data/c166:3", "E:ID_MM_DEVICE_IGNORE=1\n");
  CHECK(check_modem_manager(std::nullopt, machine.roots()).grade == Grade::ok);
}

TEST_CASE("doctor compares the kernel's USB memory limit with the buffer of the time tagger") {
  Machine machine;
  Config config;
  config.tdc.address = "usb:1209:0001";
  const auto grade_at = [&](const std::string& limit) {
    machine.write("sys/module/usbcore/parameters/usbfs_memory_mb", limit + "\n");
    return check_usb_memory(config, machine.roots()).grade;
  };
  // The file that contains the kernel's USB memory limit does not exist yet.
  CHECK(check_usb_memory(config, machine.roots()).grade == Grade::warning);
  CHECK(grade_at("16") == Grade::ok);
  CHECK(grade_at("0") == Grade::ok);  // the value 0 means no limit
  CHECK(grade_at("2") == Grade::ok);
  CHECK(grade_at("1") == Grade::problem);
  CHECK(has(check_usb_memory(config, machine.roots()).advice, "usbfs_memory_mb"));
  config.tdc.address = "bridge:tcp://h:1";
  CHECK(grade_at("1") == Grade::ok);
}

TEST_CASE("the doctor command reports whether the system clock is synchronised") {
  CHECK(check_clock({true, true, 0.01}).grade == Grade::ok);
  CHECK(check_clock({true, true, 0.5}).grade == Grade::warning);
  CHECK(check_clock({true, false, 16}).grade == Grade::warning);
  CHECK(has(check_clock({true, false, 16}).found, "not synchronised, maximum error 16 s"));
  CHECK(check_clock({}).grade == Grade::warning);
  CHECK(read_clock().readable);
}

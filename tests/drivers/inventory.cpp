// SPDX-License-Identifier: MIT
// Tests the device list on folders with the kernel's layout: /sys/bus/usb/devices contains links to
// the folders of the devices, which contain the folders of their interfaces.
#include "drivers/inventory/inventory.hpp"

#include <grp.h>
#include <unistd.h>

#include "../fixtures/folder.hpp"

using namespace echofuse::inventory;
namespace fs = std::filesystem;

namespace {

struct Interface {
  std::string number;
  // Path of the device node's folder relative to the interface's folder. Empty if there is no
  // device node.
  std::string node;
  // bInterfaceClass etc. in sysfs. The defaults are those of a serial port (CDC ACM).
  std::string usb_class = "02", subclass = "02", protocol = "01";
};

class Tree {
 public:
  Tree() {
    fs::permissions(root_, fs::perms(0755));
    fs::create_directories(root_ / "sys/bus/usb/devices");
  }

  Roots roots() const { return {dir("sys"), dir("dev")}; }
  std::string dir(const std::string& name) const { return (root_ / name).string(); }
  // Lists the attached devices. Each line contains the kind, the model, the serial number, the
  // firmware and the start of the advice of a device, or the key, the path, the address and the
  // fault of a node. @ is the root folder.
  std::string listed() const {
    std::string out;
    for (const auto& d : list_attached(roots())) {
      out += d.kind + ", " + d.model + ", " + d.serial + ", " + d.firmware + ", " +
             d.advice.substr(0, d.advice.find(':')) + "\n";
      for (const auto& node : d.nodes)
        out +=
            "  " + node.key + ", " + node.path + ", " + node.address + ", " + node.missing + "\n";
    }
    for (std::size_t at; (at = out.find(root_.string())) != out.npos;)
      out.replace(at, root_.string().size(), "@");
    return out;
  }

  void device(const std::string& place, const std::string& vendor, const std::string& product,
              const std::string& serial, const std::vector<Interface>& interfaces = {},
              const std::string& model = "A model") {
    const std::string target = "devices/pci0/usb1/" + place;
    const fs::path folder = root_ / "sys" / target;
    for (const auto& [name, text] : {std::pair{"idVendor", vendor},
                                     {"idProduct", product},
                                     {"bcdDevice", "0302"},
                                     {"busnum", "1"},
                                     {"devnum", "7"},
                                     {"product", model},
                                     {"power/control", "auto"},
                                     {"serial", serial}})
      if (!text.empty()) write(folder / name, text);
    fs::create_directory_symlink("../../../" + target, root_ / "sys/bus/usb/devices" / place);
    for (const auto& [number, node, usb_class, subclass, protocol] : interfaces) {
      const fs::path inside = folder / (place + ":1." + number.substr(1));
      write(inside / "bInterfaceNumber", number);
      write(inside / "bInterfaceClass", usb_class);
      write(inside / "bInterfaceSubClass", subclass);
      write(inside / "bInterfaceProtocol", protocol);
      fs::create_directories(inside / node);
      if (!node.empty()) write(root_ / "dev" / fs::path(node).filename(), "");
    }
  }
  // Adds a link in /dev/serial/`kind`.
  void link(const std::string& kind, const std::string& name, const std::string& node) {
    fs::create_directories(root_ / "dev/serial" / kind);
    fs::create_symlink("../../" + node, root_ / "dev/serial" / kind / name);
  }

 private:
  static void write(const fs::path& file, const std::string& text) {
    fs::create_directories(file.parent_path());
    std::ofstream(file) << text << '\n';
  }
  const echofuse::test::Folder folder_;
  const fs::path root_ = folder_.path;
};

}  // namespace

TEST_CASE("known USB devices are listed with the roles, stable names and faults of their ports") {
  Tree tree;
  // udev has not created a link for the data port of the first board.
  tree.device("1-1", "0451", "bef3", "R1",
              {{"00", "tty/ttyACM1"}, {"02", ""}, {"03", "tty/ttyACM0"}});
  tree.link("by-id", "usb-Texas_Instruments_XDS110_R1-if00", "ttyACM1");
  tree.device("1-2", "10c4", "ea70", "00E2", {{"00", "ttyUSB0/tty/ttyUSB0"}, {"01", ""}});
  tree.device("1-3", "10c4", "ea80", "00A1", {{"00", "0003:10C4:EA80.0001/hidraw/hidraw3"}});
  tree.device("1-4", "10c4", "ea80", "");
  tree.device("1-5", "2bc5", "0670", "CP1");
  tree.device("1-6", "151f", "002b", "17");
  tree.device("1-7", "8086", "0b07", "R2", {}, "Intel(R) RealSense(TM) Depth Camera 435");
  tree.device("1-8", "8086", "0b63", "", {}, "USB Bridge");  // not listed
  tree.device("1-9", "046d", "c077", "");                    // a mouse, not listed
  tree.device("2-1", "1234", "5678", "T1", {{"00", "", "ff", "45", "01"}});
  for (const auto& [place, interface] : {std::pair{"2-2", Interface{"00", "", "ff", "45", "02"}},
                                         {"2-3", {"00", "", "ff", "46", "01"}},
                                         {"2-4", {"00", "", "fe", "45", "01"}}})
    tree.device(place, "1234", "5678", "T2", {interface});  // not listed
  const std::string usb =
                        "  , @/dev/bus/usb/001/007, , @/dev/bus/usb/001/007: No such file or "
                        "directory\n",
                    driver = "no device node; load the kernel driver ";
  CHECK(tree.listed() ==
        "TI XDS110 (radar board), A model, R1, 3.02, \n"
        "  radar.cli, @/dev/ttyACM1, "
        "serial:@/dev/serial/by-id/usb-Texas_Instruments_XDS110_R1-if00, \n"
        "  radar.data, @/dev/ttyACM0, serial:@/dev/ttyACM0, \n"
        "CP2105 (radar board), A model, 00E2, 3.02, \n"
        "  radar.cli, @/dev/ttyUSB0, serial:@/dev/ttyUSB0, \n"
        "  radar.data, , , " +
            driver +
            "cdc_acm or cp210x\n"
            "CP2110 HID serial bridge, A model, 00A1, 3.02, \n"
            "  radar.cli or radar.data, @/dev/hidraw3, hid:10c4:ea80:00A1, \n"
            "CP2110 HID serial bridge, A model, , 3.02, \n"
            "  radar.cli or radar.data, , hid:10c4:ea80, " +
            driver +
            "hidraw\n"
            "Orbbec camera, A model, CP1, 3.02, start echofuse-bridge-orbbec\n" +
            usb +
            "Opal Kelly FPGA (Swabian Time Tagger), A model, 17, 3.02, start "
            "echofuse-bridge-timetagger\n" +
            usb +
            "RealSense camera, Intel(R) RealSense(TM) Depth Camera 435, R2, 3.02, start "
            "echofuse-bridge-realsense\n" +
            usb +
            "USB time tagger, A model, T1, 3.02, \n  tdc.address, @/dev/bus/usb/001/007, "
            "usb:1234:5678:T1, @/dev/bus/usb/001/007: No such file or directory\n");
}

TEST_CASE("an inaccessible device node is reported with its group or the missing udev rules") {
  Tree tree;
  tree.device("1-2", "0451", "bef3", "R1", {{"00", "tty/ttyACM0"}});
  fs::permissions(tree.dir("dev/ttyACM0"), fs::perms(0));
  const bool root = ::geteuid() == 0;
  const group* const dialout = root ? ::getgrnam("dialout") : nullptr;
  std::string help = "install config/70-echofuse.rules";
  if (dialout && GENERATE(false, true)) {
    REQUIRE(::chown(tree.dir("dev/ttyACM0").c_str(), 0, dialout->gr_gid) == 0);
    fs::permissions(tree.dir("dev/ttyACM0"), fs::perms(0660));
    help = "join the group dialout and log in again";
  }
  if (root) REQUIRE(::setresuid(65534, 65534, 0) == 0);
  const auto list = list_attached(tree.roots());
  if (root) REQUIRE(::setresuid(0, 0, 0) == 0);
  CHECK(list.at(0).nodes.at(0).missing ==
        "no read/write permission on " + tree.dir("dev/ttyACM0") + ": " + help);
}

TEST_CASE("the switch of the power saving of a device is found by each of its nodes") {
  Tree tree;
  tree.device("1-1", "0451", "bef3", "R1", {{"00", "tty/ttyACM1"}});
  const std::string control = tree.dir("sys/bus/usb/devices/1-1/power/control");
  for (const char* node : {"dev/ttyACM1", "dev/bus/usb/001/007"})
    CHECK(suspension_switch(tree.dir(node), tree.roots()) == control);
  CHECK(suspension_switch(tree.dir("dev/ttyACM0"), tree.roots()).empty());
  std::ofstream(control) << "on\n";
  CHECK(suspension_switch(tree.dir("dev/ttyACM1"), tree.roots()).empty());
}

TEST_CASE("no devices are listed if sysfs is missing") {
  CHECK(list_attached({"/nowhere/sys", "/nowhere/dev"}).empty());
  CHECK_FALSE(radar_port("/dev/ttyACM0", {"/nowhere/sys", "/nowhere/dev"}));
}

TEST_CASE("the role of a radar port is derived from its device path") {
  Tree tree;
  tree.device("1-2", "0451", "bef3", "R1", {{"00", "tty/ttyACM1"}, {"03", "tty/ttyACM0"}});
  tree.device("1-3", "1a86", "7523", "", {{"00", "ttyUSB0/tty/ttyUSB0"}});  // unsupported vendor
  const std::string xds110 = "serial/by-id/usb-Texas_Instruments_XDS110__03.00_R1-if",
                    cp2105 = "serial/by-id/usb-Silicon_Labs_CP2105_Dual_UART_00E2-if";
  const auto check = [&](std::optional<RadarPort> role, const std::vector<std::string>& paths) {
    for (const std::string& path : paths) {
      CAPTURE(path);
      CHECK((radar_port("/dev/" + path, tree.roots()) == role));
    }
  };
  check(RadarPort::command, {xds110 + "00", cp2105 + "00-port0", "ttyACM1"});
  check(RadarPort::data, {xds110 + "03", cp2105 + "01-port0", "ttyACM0"});
  check({}, {xds110 + "02", xds110 + "zz", xds110 + "0", xds110, cp2105 + "03-port0", "ttyUSB0",
             "ttyS0", "serial/by-id/usb-FTDI_FT232R_A1-if00-port0"});
}

TEST_CASE("two boards with the same serial number are listed by USB port") {
  Tree tree;
  const std::string serial = GENERATE("R0081038", "R0099999");
  for (const bool second : {false, true}) {
    const std::string place = second ? "1-2" : "1-1", cli = "ttyACM" + std::to_string(2 * second),
                      data = "ttyACM" + std::to_string(2 * second + 1);
    tree.device(place, "0451", "bef3", second ? serial : "R0081038",
                {{"00", "tty/" + cli}, {"03", "tty/" + data}});
    tree.link("by-path", "pci-usb-" + place + ":1.0", cli);
    tree.link("by-path", "pci-usb-" + place + ":1.3", data);
  }
  tree.link("by-id", "usb-TI_XDS110_R0081038-if00", "ttyACM2");
  const auto list = list_attached(tree.roots());
  REQUIRE(list.size() == 2);
  if (serial == "R0081038") {
    CHECK(list[0].nodes[0].address == "serial:" + tree.dir("dev/serial/by-path/pci-usb-1-1:1.0"));
    CHECK(list[1].nodes[1].address == "serial:" + tree.dir("dev/serial/by-path/pci-usb-1-2:1.3"));
    CHECK(list[1].advice.find("another board has the same serial number R0081038") == 0);
  } else {
    CHECK(list[1].nodes[0].address ==
          "serial:" + tree.dir("dev/serial/by-id/usb-TI_XDS110_R0081038-if00"));
    CHECK(list[1].advice.empty());
  }
  const auto boards = [&](const std::string& cli, const std::string& data) {
    return two_boards(tree.dir(cli), tree.dir(data), tree.roots());
  };
  CHECK(boards("dev/ttyACM0", "dev/ttyACM1").empty());
  CHECK(boards("dev/serial/by-path/pci-usb-1-1:1.0", "dev/serial/by-path/pci-usb-1-2:1.3") ==
        "TI XDS110 (radar board) R0081038 at USB 1-1, TI XDS110 (radar board) " + serial +
            " at USB 1-2");
  CHECK(boards("dev/ttyACM0", "dev/ttyS9").empty());
}

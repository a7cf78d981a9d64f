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

class Tree {
 public:
  Tree() {
    fs::permissions(root_, fs::perms(0755));
    fs::create_directories(root_ / "sys/bus/usb/devices");
    fs::create_directories(root_ / "dev/serial/by-id");
  }

  Roots roots() const { return {dir("sys"), dir("dev")}; }
  // Lists the attached devices. Each line contains the model, the serial number and the firmware of
  // a device, or the key, the path, the address and the fault of a node. @ is the root folder.
  std::string listed() const {
    std::string out;
    for (const auto& device : list_attached(roots())) {
      out += device.model + ", " + device.serial + ", " + device.firmware + "\n";
      for (const auto& node : device.nodes)
        out +=
            "  " + node.key + ", " + node.path + ", " + node.address + ", " + node.missing + "\n";
    }
    for (std::size_t at; (at = out.find(root_.string())) != out.npos;)
      out.replace(at, root_.string().size(), "@");
    return out;
  }
  std::string dir(const std::string& name) const { return (root_ / name).string(); }

  void device(const std::string& place, const std::string& vendor, const std::string& product,
              const std::string& serial, const std::string& model = "A model") {
    const fs::path folder = root_ / "sys/devices/pci0/usb1" / place;
    fs::create_directories(folder);
    write(folder / "idVendor", vendor);
    write(folder / "idProduct", product);
    write(folder / "bcdDevice", "0302");
    write(folder / "busnum", "1");
    write(folder / "devnum", "7");
    write(folder / "product", model);
    if (!serial.empty()) write(folder / "serial", serial);
    fs::create_directory_symlink("../../../devices/pci0/usb1/" + place,
                                 root_ / "sys/bus/usb/devices" / place);
  }
  // Adds an interface. `node` is the path of the device node's folder relative to the interface's
  // folder. `node` is empty if there is no device node.
  void interface(const std::string& place, const std::string& number, const std::string& node) {
    const fs::path folder =
        root_ / "sys/devices/pci0/usb1" / place / (place + ":1." + std::to_string(stoi(number)));
    fs::create_directories(folder / node);
    write(folder / "bInterfaceNumber", number);
    if (!node.empty()) write(root_ / "dev" / fs::path(node).filename(), "");
  }
  void by_id(const std::string& name, const std::string& node) { link("by-id", name, node); }
  void link(const std::string& kind, const std::string& name, const std::string& node) {
    fs::create_directories(root_ / "dev/serial" / kind);
    fs::create_symlink("../../" + node, root_ / "dev/serial" / kind / name);
  }

 private:
  static void write(const fs::path& file, const std::string& text) {
    std::ofstream(file) << text << '\n';
  }
  const echofuse::test::Folder folder_;
  const fs::path root_ = folder_.path;
};

}  // namespace

TEST_CASE("an XDS110 debug probe is listed with two ports, their roles and stable names") {
  Tree tree;
  tree.device("1-2", "0451", "bef3", "R0081038");
  tree.interface("1-2", "00", "tty/ttyACM1");
  tree.interface("1-2", "02", "");
  tree.interface("1-2", "03", "tty/ttyACM0");
  tree.by_id("usb-Texas_Instruments_XDS110_R0081038-if00", "ttyACM1");
  tree.device("1-3", "046d", "c077", "");  // adds a mouse, which must not be listed
  // udev has not created a link for the data port.
  CHECK(tree.listed() ==
        "A model, R0081038, 3.02\n"
        "  radar.cli, @/dev/ttyACM1, "
        "serial:@/dev/serial/by-id/usb-Texas_Instruments_XDS110_R0081038-if00, \n"
        "  radar.data, @/dev/ttyACM0, serial:@/dev/ttyACM0, \n");
}

TEST_CASE("the ports of a CP2105 are found in sysfs, and a missing kernel driver is reported") {
  Tree tree;
  tree.device("1-2", "10c4", "ea70", "00E2");
  tree.interface("1-2", "00", "ttyUSB0/tty/ttyUSB0");
  tree.interface("1-2", "01", "");
  CHECK_THAT(tree.listed(), Catch::StartsWith("A model, 00E2, 3.02\n"
                                              "  radar.cli, @/dev/ttyUSB0, serial:@/dev/ttyUSB0, \n"
                                              "  radar.data, , ") &&
                                Catch::Contains("cdc_acm or cp210x"));
}

TEST_CASE("CP2110, Orbbec and Time Tagger devices are listed by addresses with serial numbers") {
  Tree tree;
  tree.device("1-1", "10c4", "ea80", "00A1");
  tree.interface("1-1", "00", "0003:10C4:EA80.0001/hidraw/hidraw3");
  tree.device("1-2", "10c4", "ea80", "");
  tree.device("1-3", "2bc5", "0670", "CP1");
  tree.device("1-4", "151f", "002b", "17");
  const auto list = list_attached(tree.roots());
  REQUIRE(list.size() == 4);
  CHECK(list[0].nodes.at(0).path == tree.dir("dev/hidraw3"));
  CHECK(list[0].nodes.at(0).address == "hid:10c4:ea80:00A1");
  CHECK(list[1].nodes.at(0).address == "hid:10c4:ea80");
  CHECK(list[1].nodes.at(0).path.empty());
  CHECK_THAT(list[1].nodes.at(0).missing, Catch::Contains("hidraw"));
  CHECK(list[2].nodes.at(0).missing ==
        tree.dir("dev/bus/usb/001/007") + ": No such file or directory");
  CHECK(list[2].nodes.at(0).path == tree.dir("dev/bus/usb/001/007"));
  CHECK_THAT(list[2].advice, Catch::Contains("depth.address"));
  CHECK_THAT(list[3].advice, Catch::Contains("bridge:tcp"));
}

TEST_CASE("RealSense cameras are listed by name, and other Intel devices are not listed") {
  Tree tree;
  tree.device("1-1", "8086", "0b07", "R1", "Intel(R) RealSense(TM) Depth Camera 435");
  tree.device("1-2", "8086", "0b63", "", "USB Bridge");
  const auto list = list_attached(tree.roots());
  REQUIRE(list.size() == 1);
  CHECK(list[0].kind == "RealSense camera");
  CHECK_THAT(list[0].advice, Catch::Contains("echofuse-bridge-realsense: depth.address = "));
}

TEST_CASE("an inaccessible device node is reported with its group or the missing udev rules") {
  Tree tree;
  tree.device("1-2", "0451", "bef3", "R1");
  tree.interface("1-2", "00", "tty/ttyACM0");
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

TEST_CASE("no devices are listed if sysfs is missing") {
  CHECK(list_attached({"/nowhere/sys", "/nowhere/dev"}).empty());
  CHECK_FALSE(radar_port("/dev/ttyACM0", {"/nowhere/sys", "/nowhere/dev"}));
}

TEST_CASE("the role of a radar port is derived from its device path") {
  Tree tree;
  tree.device("1-2", "0451", "bef3", "R1");
  tree.interface("1-2", "00", "tty/ttyACM1");
  tree.interface("1-2", "03", "tty/ttyACM0");
  tree.device("1-3", "1a86", "7523", "");
  tree.interface("1-3", "00", "ttyUSB0/tty/ttyUSB0");
  const auto role = [&](const std::string& path) { return radar_port(path, tree.roots()); };
  const std::string by_id = "/dev/serial/by-id/usb-";
  CHECK(role(by_id + "Texas_Instruments_XDS110__03.00_R1-if00") == RadarPort::command);
  CHECK(role(by_id + "Texas_Instruments_XDS110__03.00_R1-if03") == RadarPort::data);
  CHECK(role(by_id + "Silicon_Labs_CP2105_Dual_UART_00E2-if00-port0") == RadarPort::command);
  CHECK(role(by_id + "Silicon_Labs_CP2105_Dual_UART_00E2-if01-port0") == RadarPort::data);
  CHECK_FALSE(role(by_id + "Texas_Instruments_XDS110__03.00_R1-if02"));
  CHECK_FALSE(role(by_id + "FTDI_FT232R_A1-if00-port0"));
  CHECK_FALSE(role(by_id + "XDS110-ifzz"));
  CHECK_FALSE(role(by_id + "XDS110-if"));
  CHECK(role("/dev/ttyACM1") == RadarPort::command);
  CHECK(role("/dev/ttyACM0") == RadarPort::data);
  CHECK_FALSE(role("/dev/ttyUSB0"));  // port of a device from an unsupported vendor
  CHECK_FALSE(role("/dev/ttyS0"));
}

TEST_CASE("two boards with the same serial number are listed by USB port") {
  Tree tree;
  const std::string serial = GENERATE("R0081038", "R0099999");
  for (const auto& [place, number, node] :
       {std::tuple("1-1", "R0081038", 0), {"1-2", serial.c_str(), 2}}) {
    tree.device(place, "0451", "bef3", number);
    for (const int port : {0, 3}) {
      const std::string tty = "ttyACM" + std::to_string(node + (port > 0));
      tree.interface(place, "0" + std::to_string(port), "tty/" + tty);
      tree.link("by-path", std::string("pci-usb-") + place + ":1." + std::to_string(port), tty);
    }
  }
  tree.by_id("usb-TI_XDS110_R0081038-if00", "ttyACM2");
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

// SPDX-License-Identifier: MIT
// Tests the HID port with the stock hidapi and an emulated CP2110.
#include <hidapi/hidapi.h>
#include <unistd.h>

#include <chrono>

#include "../fixtures/folder.hpp"
#include "../fixtures/shell.hpp"
#include "bed.hpp"
#include "drivers/inventory/inventory.hpp"
#include "drivers/port/loop.hpp"
#include "drivers/port/open_port.hpp"
#include "tests/emulation/hid_cp2110.hpp"

using namespace std::chrono_literals;

namespace {

// Emulated CP2110 that stores the bytes received from the host over the UART.
class Bridge {
 public:
  explicit Bridge(const std::string& serial = "A", unsigned number = 0)
      : device(test::bed(), {number, serial}, [this](ByteView bytes) {
          const std::lock_guard lock(mutex_);
          sent_.insert(sent_.end(), bytes.begin(), bytes.end());
          counts_.push_back(bytes.size());
        }) {}
  Bytes sent() const {
    const std::lock_guard lock(mutex_);
    return sent_;
  }
  std::vector<std::size_t> counts() const {
    const std::lock_guard lock(mutex_);
    return counts_;
  }

 private:
  mutable std::mutex mutex_;
  Bytes sent_;
  std::vector<std::size_t> counts_;

 public:
  sim::HidCp2110 device;
};

// HID port that stores the events and bytes reported to it.
struct Host {
  void open(const std::string& serial = "", std::uint32_t baud = 115200) {
    opened = gone = 0;
    port = port::make_hid_port(loop.io(), {0x10c4, 0xea80, serial}, baud);
    port->open(
        {[this] { ++opened; },
         [this](ByteView bytes) { received.insert(received.end(), bytes.begin(), bytes.end()); },
         [this](const Failure& failure) {
           ++gone;
           why = failure.text();
         },
         [this](const std::string& text, std::uint64_t count) {
           warnings.push_back(text);
           losses += count;
         }});
  }
  template <class Condition>
  bool until(Condition condition, std::chrono::milliseconds limit = 10s) {
    loop.run_until(condition, loop.now() + limit);
    return condition();
  }
  void opens(const std::string& serial = "", std::uint32_t baud = 115200) {
    open(serial, baud);
    REQUIRE(until([this] { return opened + gone > 0; }));
    INFO(why);
    REQUIRE(opened == 1);
  }
  void goes() {
    REQUIRE(until([this] { return gone > 0; }));
  }

  port::SystemLoop loop;
  std::unique_ptr<port::BytePort> port;
  int opened = 0, gone = 0;
  Bytes received;
  std::string why;
  std::vector<std::string> warnings;
  std::uint64_t losses = 0;
};

Bytes pattern(std::size_t n) {
  Bytes bytes(n);
  for (std::size_t i = 0; i < n; ++i) bytes[i] = static_cast<std::uint8_t>(i * 7 + i / 256);
  return bytes;
}

}  // namespace

TEST_CASE("the CP2110 with the requested serial number is opened and configured") {
  Bridge a("A", 0), b("B", 1);
  Host host;
  host.opens("B", 921600);
  CHECK(b.device.chip().on());
  CHECK(b.device.chip().config() == Bytes{0x50, 0x00, 0x0E, 0x10, 0x00, 0, 0, 3, 0});
  CHECK_FALSE(a.device.chip().on());
  Host other;
  other.opens("A");
  CHECK(a.device.chip().baud() == 115200);
}

TEST_CASE("an address that matches two CP2110 devices is refused") {
  Bridge a("A", 0), b("B", 1);
  Host host;
  host.open();
  host.goes();
  CHECK_THAT(host.why,
             Catch::StartsWith(
                 "hid:10c4:ea80: cannot open; the address matches several devices (attached: "));
}

TEST_CASE("a HID port transfers bytes both ways and splits long writes") {
  Bridge bridge;
  Host host;
  host.opens();
  const Bytes out = pattern(200), in = pattern(400);
  host.port->write(out);
  REQUIRE(host.until([&] { return bridge.sent().size() >= out.size(); }));
  CHECK(bridge.sent() == out);
  CHECK(bridge.counts() == std::vector<std::size_t>{63, 63, 63, 11});
  CHECK(bridge.device.receive(in) == in.size());
  REQUIRE(host.until([&] { return host.received.size() >= in.size(); }));
  CHECK(host.received == in);
  CHECK(host.warnings.empty());
}

TEST_CASE("bytes received before a HID port was opened are discarded") {
  Bridge bridge;
  Host host;
  host.opens();
  host.port.reset();
  bridge.device.receive(pattern(300));
  host.opens();
  const Bytes fresh{1, 2, 3};
  bridge.device.receive(fresh);
  REQUIRE(host.until([&] { return host.received.size() >= fresh.size(); }));
  CHECK(host.received == fresh);
}

TEST_CASE("an overrun in the CP2110 is reported and counted once") {
  Bridge bridge;
  Host host;
  host.opens();
  CHECK(bridge.device.receive(pattern(700)) == 480);
  REQUIRE(host.until([&] { return !host.warnings.empty(); }));
  CHECK(host.warnings == std::vector<std::string>{"hid:10c4:ea80: overrun: the bridge lost bytes"});
  CHECK(host.losses == 1);
  CHECK(host.received == Bytes(pattern(480)));
  host.until([] { return false; }, 1500ms);
  CHECK(host.losses == 1);
}

TEST_CASE("a baud rate above the USB throughput causes a warning") {
  Bridge bridge;
  Host host;
  host.opens("A", 921600);
  REQUIRE(host.until([&] { return !host.warnings.empty(); }));
  CHECK_THAT(host.warnings.at(0), Catch::StartsWith("hid:10c4:ea80:A: 921600 baud"));
  CHECK(host.losses == 0);
  host.warnings.clear();
  host.opens("A", 460800);
  bridge.device.receive(Bytes{1});
  REQUIRE(host.until([&] { return !host.received.empty(); }));
  CHECK(host.warnings.empty());
}

TEST_CASE("an unplugged HID port reports one failure, and reopening it reports a missing device") {
  Bridge bridge;
  Host host;
  host.opens("A");
  bridge.device.unplug();
  host.goes();
  CHECK_THAT(host.why, Catch::StartsWith("hid:10c4:ea80:A: read: "));
  host.port->write(pattern(10));
  host.until([] { return false; }, 50ms);
  CHECK(host.gone == 1);
  host.open("A");
  host.goes();
  CHECK(host.why == "hid:10c4:ea80:A: cannot open: No such device");
  bridge.device.plug();
  host.opens("A");
  CHECK(bridge.sent().empty());
}

TEST_CASE("a CP2110 is reopened after each of 100 disconnections") {
  Bridge bridge;
  Host host;
  const auto start = std::chrono::steady_clock::now();
  for (std::uint8_t i = 0; i < 100; ++i) {
    host.opens("A");
    host.received.clear();
    bridge.device.receive(Bytes{i, i});
    REQUIRE(host.until([&] { return host.received.size() == 2; }));
    CHECK(host.received == Bytes{i, i});
    bridge.device.unplug();
    host.goes();
    CHECK(host.gone == 1);
    bridge.device.plug();
  }
  WARN("100 cycles in "
       << std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() << " s");
}

TEST_CASE("the error for a wrong serial number lists the attached CP2110 devices") {
  Bridge bridge("A");
  Host host;
  host.open("Z");
  host.goes();
  CHECK(host.why == "hid:10c4:ea80:Z: cannot open (attached: A): No such device");
}

TEST_CASE("a CP2110 in use by another program is refused and can be opened later") {
  Bridge bridge;
  Host first, second;
  first.opens("A");
  second.open();
  second.goes();
  CHECK(second.why ==
        "hid:10c4:ea80: cannot open /dev/hidraw0 (in use by another program): Device or resource "
        "busy");
  // The emulation notices each open() with a delay and then empties the buffer. The three expected
  // calls of open() are made to lock the device, by hidapi, and by the second program.
  REQUIRE(second.until([&] { return bridge.device.opened() == 3; }));
  bridge.device.receive(pattern(100));
  CHECK(first.until([&] { return first.received == pattern(100); }));
  first.port.reset();
  second.opens();
}

TEST_CASE("a missing permission is reported with a remedy when a CP2110 is opened or listed") {
  Bridge bridge;
  const std::string root = test::bed().root(), node = root + "/dev/hidraw0";
  // Every user is given access to the files of the emulation, but not to the device node.
  std::filesystem::permissions(root, std::filesystem::perms(0755));
  for (const auto& entry : std::filesystem::recursive_directory_iterator(root + "/ioctl"))
    std::filesystem::permissions(entry, std::filesystem::perms(0777));
  std::filesystem::permissions(node, std::filesystem::perms(0));
  const bool is_root = ::geteuid() == 0;
  if (is_root) REQUIRE(::setresuid(65534, 65534, 0) == 0);
  Host host;
  host.open("A");
  const bool reported = host.until([&] { return host.gone > 0; });
  const auto list = inventory::list_attached();
  if (is_root) REQUIRE(::setresuid(0, 0, 0) == 0);
  REQUIRE(reported);
  CHECK(host.why ==
        "hid:10c4:ea80:A: cannot open /dev/hidraw0 (install config/70-echofuse.rules): "
        "Permission denied");
  REQUIRE(list.size() == 1);
  CHECK(list[0].serial == "A");
  CHECK(list[0].nodes.at(0).address == "hid:10c4:ea80:A");
  CHECK(list[0].nodes[0].missing ==
        "no read/write permission on /dev/hidraw0: install config/70-echofuse.rules");
}

TEST_CASE("bytes lost by a slow reader of a HID port are counted") {
  Bridge bridge;
  Host host;
  host.opens();
  constexpr std::uint64_t reports = 6000, kept = 256 << 10;
  const Bytes report(64, 63);
  for (std::uint64_t i = 0; i < reports; ++i) {
    // Waits until the port has read most of the reports, because the kernel's buffer must not
    // overflow in this test.
    while (bridge.device.host_waiting() > 1000) std::this_thread::sleep_for(1ms);
    bridge.device.raw_input(report);
  }
  REQUIRE(host.until([&] { return host.received.size() + host.losses == reports * 63; }));
  CHECK(bridge.device.host_dropped() == 0);
  CHECK(host.received.size() >= kept);
  CHECK(host.losses > 0);
  CHECK_THAT(host.warnings.at(0), Catch::Contains("did not read them in time"));
}

TEST_CASE("the devices command prints the address of a CP2110 as a TOML string") {
  const auto [serial, printed, in_toml] = GENERATE(table<std::string, std::string, std::string>(
      {{"00A1", "00A1", R"("hid:10c4:ea80:00A1")"},
       {"0\"1\x02", R"(0"1\x02)", R"("hid:10c4:ea80:0\"1\u0002")"}}));
  Bridge bridge(serial);
  const echofuse::test::Folder folder;
  const auto [code, text] =
      echofuse::test::shell("cd " + folder.path.string() + " && " + echofuse::test::bin_dir +
                            "/echofuse-acquire devices");
  CHECK(code == 0);
  CHECK_THAT(text, Catch::Contains("CP2110 HID serial bridge 10c4:ea80: model CP2110 HID "
                                   "USB-to-UART Bridge, serial " +
                                   printed + ", firmware 1.00") &&
                       Catch::Contains("radar.cli or radar.data = " + in_toml));
}

TEST_CASE("a HID port can be destroyed at any time, and no event follows") {
  Bridge bridge;
  Host host;
  for (int i = 0; i < 20; ++i) {
    host.open("A");
    host.until([] { return false; }, std::chrono::milliseconds(i / 2));
    bridge.device.receive(pattern(100));
    host.port.reset();
    host.opened = host.gone = 0;
    host.received.clear();
    host.until([] { return false; }, 2ms);
    CHECK(host.opened + host.gone == 0);
    CHECK(host.received.empty());
  }
}

// SPDX-License-Identifier: MIT
// Tests the HID port with the stock hidapi and an emulated CP2110.
#include <hidapi/hidapi.h>
#include <unistd.h>

#include <chrono>

#include "../catch.hpp"
#include "../fixtures/shell.hpp"
#include "bed.hpp"
#include "drivers/inventory/inventory.hpp"
#include "drivers/port/loop.hpp"
#include "drivers/port/open_port.hpp"
#include "tests/emulation/hid_cp2110.hpp"

using namespace std::chrono_literals;

namespace {

Bytes pattern(std::size_t n) {
  Bytes bytes(n);
  for (std::size_t i = 0; i < n; ++i) bytes[i] = static_cast<std::uint8_t>(i * 7 + i / 256);
  return bytes;
}

// HID port that stores the events and bytes reported to it.
struct Host {
  void open(const std::string& serial = "", std::uint32_t baud = 115200) {
    opened = gone = 0;
    received.clear();
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
  // Waits until the port fails. Returns the reason.
  std::string goes() {
    REQUIRE(until([this] { return gone > 0; }));
    return why;
  }
  std::string refusal(const std::string& serial = "") {
    open(serial);
    return goes();
  }
  bool receives(const Bytes& bytes) {
    until([&] { return received.size() >= bytes.size(); });
    return received == bytes;
  }
  bool warned() {
    return until([this] { return !warnings.empty(); });
  }

  port::SystemLoop loop;
  std::unique_ptr<port::BytePort> port;
  int opened = 0, gone = 0;
  Bytes received;
  std::string why;
  std::vector<std::string> warnings;
  std::uint64_t losses = 0;
};

// Emulated CP2110 that stores the pieces in which the host sends bytes over the UART.
class Bridge {
 public:
  explicit Bridge(const std::string& serial = "A", unsigned number = 0)
      : device(test::bed(), {number, serial}, [this](ByteView bytes) {
          const std::lock_guard lock(mutex_);
          sent_.emplace_back(bytes.begin(), bytes.end());
        }) {}
  std::vector<Bytes> sent() const {
    const std::lock_guard lock(mutex_);
    return sent_;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<Bytes> sent_;

 public:
  sim::HidCp2110 device;
};

}  // namespace

TEST_CASE("the CP2110 with the requested serial number is opened and configured") {
  Bridge a("A", 0), b("B", 1);
  Host host, other;
  host.opens("B", 921600);
  CHECK(b.device.chip().on());
  CHECK(b.device.chip().config() == Bytes{0x50, 0x00, 0x0E, 0x10, 0x00, 0, 0, 3, 0});
  CHECK_FALSE(a.device.chip().on());
  other.opens("A");
  CHECK(a.device.chip().config() == Bytes{0x50, 0x00, 0x01, 0xC2, 0x00, 0, 0, 3, 0});
  CHECK_THAT(Host().refusal(),
             Catch::StartsWith("hid:10c4:ea80: cannot open; the address matches several devices "
                               "(attached: "));
  CHECK_THAT(Host().refusal("Z"), Catch::StartsWith("hid:10c4:ea80:Z: cannot open (attached: ") &&
                                      Catch::EndsWith("): No such device"));
}

TEST_CASE("a HID port transfers bytes both ways and splits long writes") {
  Bridge bridge;
  Host host;
  host.opens();
  const Bytes out = pattern(200), in = pattern(400);
  host.port->write(out);
  REQUIRE(host.until([&] { return bridge.sent().size() >= 4; }));
  const auto piece = [&](int from, int to) { return Bytes(out.begin() + from, out.begin() + to); };
  CHECK(bridge.sent() ==
        std::vector{piece(0, 63), piece(63, 126), piece(126, 189), piece(189, 200)});
  CHECK(bridge.device.receive(in) == in.size());
  CHECK(host.receives(in));
  CHECK(host.warnings.empty());
}

TEST_CASE("bytes received before a HID port was opened are discarded") {
  Bridge bridge;
  Host host;
  host.opens();
  host.port.reset();
  bridge.device.receive(pattern(300));
  host.opens();
  bridge.device.receive(Bytes{1, 2, 3});
  CHECK(host.receives({1, 2, 3}));
}

TEST_CASE("an overrun in the CP2110 is reported and counted once") {
  Bridge bridge;
  Host host;
  host.opens();
  CHECK(bridge.device.receive(pattern(700)) == 480);
  REQUIRE(host.warned());
  CHECK(host.warnings == std::vector<std::string>{"hid:10c4:ea80: overrun: the bridge lost bytes"});
  CHECK(host.losses == 1);
  CHECK(host.received == pattern(480));
  host.until([] { return false; }, 1500ms);
  CHECK(host.losses == 1);
}

TEST_CASE("a baud rate above the USB throughput causes a warning") {
  Bridge bridge;
  Host host;
  host.opens("A", 921600);
  REQUIRE(host.warned());
  CHECK_THAT(host.warnings.at(0), Catch::StartsWith("hid:10c4:ea80:A: 921600 baud"));
  CHECK(host.losses == 0);
  host.warnings.clear();
  host.opens("A", 460800);
  bridge.device.receive(Bytes{1});
  CHECK(host.receives({1}));
  CHECK(host.warnings.empty());
}

TEST_CASE("a CP2110 is reopened after each of 100 disconnections") {
  Bridge bridge;
  Host host;
  for (std::uint8_t i = 0; i < 100; ++i) {
    host.opens("A");
    bridge.device.receive(Bytes{i, i});
    CHECK(host.receives({i, i}));
    bridge.device.unplug();
    CHECK_THAT(host.goes(), Catch::StartsWith("hid:10c4:ea80:A: read: "));
    if (i == 0) {
      host.port->write(pattern(10));
      host.until([] { return false; }, 50ms);
      CHECK(host.gone == 1);
      CHECK(host.refusal("A") == "hid:10c4:ea80:A: cannot open: No such device");
    }
    bridge.device.plug();
  }
  CHECK(bridge.sent().empty());
}

TEST_CASE("a CP2110 in use by another program is refused and can be opened later") {
  Bridge bridge;
  Host first, second;
  first.opens("A");
  CHECK(second.refusal() ==
        "hid:10c4:ea80: cannot open /dev/hidraw0 (in use by another program): Device or resource "
        "busy");
  // The emulation notices each open() with a delay and then empties the buffer. The three expected
  // calls of open() are made to lock the device, by hidapi, and by the second program.
  REQUIRE(second.until([&] { return bridge.device.opened() == 3; }));
  bridge.device.receive(pattern(100));
  CHECK(first.receives(pattern(100)));
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
  Bridge bridge("0\"1\x02");
  const auto [code, text] = test::shell(test::bin_dir + "/echofuse-acquire devices");
  CHECK(code == 0);
  CHECK_THAT(text, Catch::Contains("CP2110 HID serial bridge 10c4:ea80: model CP2110 HID "
                                   "USB-to-UART Bridge, serial 0\"1\\x02, firmware 1.00") &&
                       Catch::Contains(R"(radar.cli or radar.data = "hid:10c4:ea80:0\"1\u0002")"));
}

TEST_CASE("a HID port can be destroyed at any time, and no event follows") {
  Bridge bridge;
  Host host;
  for (int i = 0; i < 20; ++i) {
    host.open("A");
    host.until([] { return false; }, std::chrono::milliseconds(i / 2));
    bridge.device.receive(pattern(100));
    host.port.reset();
    const auto events = [&] { return host.opened + host.gone + host.received.size(); };
    const auto before = events();
    host.until([] { return false; }, 2ms);
    CHECK(events() == before);
  }
}

// SPDX-License-Identifier: MIT
// Tests the unmodified USB tagger driver and libusb with a device emulated below usbfs.
#include "../catch.hpp"
#include "../drivers/blocks.hpp"
#include "../drivers/sink.hpp"
#include "drivers/inventory/inventory.hpp"
#include "drivers/make_driver.hpp"
#include "tests/emulation/usb_device.hpp"

using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

constexpr char address[] = "usb:1209:0001:T1";

// Simulates a USB tagger that sends the blocks given by the test.
struct Bench {
  explicit Bench(std::uint8_t subclass = 0x45)
      : device(bed, identity("T1", subclass),
               [this](const auto& setup) { return control(setup); }) {
    device.plug();
  }
  static sim::UsbIdentity identity(const std::string& serial, std::uint8_t subclass = 0x45) {
    return {0x1209, 1, 0x0203, "Maker", "Tagger", serial, subclass, 1};
  }

  std::optional<Bytes> control(const sim::UsbDevice::Setup& setup) {
    if (setup.request != 1 && setup.request != 2) return std::nullopt;
    if (setup.request == 1) device.clear();
    ++(setup.request == 1 ? starts : stops);
    return Bytes{};
  }

  void connect() {
    driver = make_tdc(loop, {address});
    driver->start(sink);
    greet();
  }
  // Answers the next start request with a hello block.
  void greet() {
    REQUIRE(run_until(loop, [&] { return starts > greeted; }));
    greeted = starts;
    sequence = 1;
    device.send(hello_block());
    REQUIRE(run_until(loop, [&] { return sink.state() == DeviceState::streaming; }));
  }
  // Returns a block of `count` tags. Each tag has a time 1 ps later than the previous tag.
  Bytes tags(std::size_t count) {
    std::vector<Tag> all(count, {.channel = 2});
    for (Tag& tag : all) tag.time_ps = ++sent;
    return bridge::make_block(bridge::BlockKind::tags, sequence++, 0, as_bytes(all));
  }
  bool arrived(std::size_t count) {
    return run_until(loop, [&] { return sink.tags.size() >= count; });
  }
  bool faulted() {
    return run_until(loop, [&] { return sink.state() == DeviceState::faulted; });
  }
  // Checks that the received tags have exactly the times in `ranges`, in this order.
  void check_times(std::vector<std::pair<std::int64_t, std::int64_t>> ranges) const {
    std::vector<std::int64_t> expected, times;
    for (const auto& [first, last] : ranges)
      for (std::int64_t i = first; i <= last; ++i) expected.push_back(i);
    for (const Tag& tag : sink.tags) times.push_back(tag.time_ps);
    CHECK(times == expected);
  }
  std::uint64_t lost_blocks() const {
    std::uint64_t all = 0;
    for (const auto& block : sink.blocks) all += block.lost_blocks;
    return all;
  }
  std::uint64_t count(const char* name) const { return counter(*driver, name); }

  sim::UsbBed bed;
  std::atomic<int> starts{0}, stops{0};
  sim::UsbDevice device;
  port::SystemLoop loop;
  KeepingSink sink;
  std::int64_t sent = 0;
  std::uint32_t sequence = 0;
  int greeted = 0;
  std::unique_ptr<Driver> driver;
};

}  // namespace

TEST_CASE("a USB tagger is found by its interface, started, read and stopped") {
  Bench b;
  const auto list = inventory::list_attached();
  REQUIRE(list.size() == 1);
  CHECK(list[0].kind == "USB time tagger");
  CHECK(list[0].nodes.at(0).key + " = " + list[0].nodes[0].address ==
        std::string("tdc.address = ") + address);
  b.connect();
  CHECK(b.sink.info.model == "test");
  CHECK(b.sink.info.address == address);
  b.device.send(b.tags(10));
  REQUIRE(b.arrived(10));
  b.check_times({{1, 10}});
  CHECK(b.lost_blocks() == 0);
  CHECK(b.count("tags") == 10);
  b.driver.reset();
  CHECK(run_until(b.loop, [&] { return b.stops == 1 && !b.device.claimed(); }));
}

TEST_CASE("no tags are lost if USB transfers split blocks or if packets are short or empty") {
  Bench b;
  b.connect();
  const Bytes all = join({b.tags(50'000), b.tags(0), b.tags(50'000)});
  // Pieces of 37 000 bytes end in the middle of tags, and the long run of packets fills entire
  // transfers.
  const ByteView wire = all;
  for (std::size_t at = 0; at < wire.size(); at += 37'000)
    b.device.send(wire.subspan(at, std::min<std::size_t>(37'000, wire.size() - at)), false);
  b.device.send({});
  REQUIRE(b.arrived(100'000));
  for (std::size_t n : {1u, 30u, 31u, 33u}) {
    b.device.send(b.tags(n));
    b.device.send({});
  }
  REQUIRE(b.arrived(static_cast<std::size_t>(b.sent)));
  b.check_times({{1, b.sent}});
  CHECK(b.lost_blocks() == 0);
  CHECK(b.count("junk_bytes") == 0);
}

TEST_CASE("a lost byte or a halted endpoint is reported once, and the USB connection is restored") {
  Bench b;
  b.connect();
  b.device.send(b.tags(5));
  REQUIRE(b.arrived(5));
  const bool halted = GENERATE(false, true);
  if (halted) {
    b.device.halt();
  } else {
    Bytes run = b.tags(5);
    run.erase(run.begin() + 40);
    b.device.send(join({run, b.tags(5)}));
  }
  REQUIRE(b.faulted());
  CHECK(b.sink.events ==
        std::vector<std::string>{halted ? std::string(address) + ": endpoint halted: Broken pipe"
                                        : "the block has a wrong checksum"});
  b.greet();
  const std::int64_t before = b.sent;
  b.device.send(b.tags(5));
  REQUIRE(b.arrived(10));
  b.check_times({{1, 5}, {before + 1, before + 5}});
  CHECK(b.lost_blocks() == 1);
  CHECK(b.count("connections") == 2);
}

TEST_CASE("a USB tagger is reopened after an unplug during a transfer") {
  Bench b;
  b.connect();
  const std::size_t cycles = std::getenv("ECHOFUSE_LONG") ? 30 : 3;
  for (std::size_t i = 1; i <= cycles; ++i) {
    Bytes cut = join({b.tags(1000), b.tags(1000)});
    cut.resize(cut.size() - 5);
    b.device.send(cut, false);  // the last bytes wait in an incomplete transfer
    b.device.unplug();
    REQUIRE(b.faulted());
    CHECK(b.sink.tags.size() == i * 1000 + (i - 1) * 4);
    b.device.plug();
    b.greet();
    b.device.send(b.tags(4));
    REQUIRE(b.arrived(i * 1004));
    CHECK(b.sink.tags.back().time_ps == b.sent);
    CHECK(b.sink.blocks.back().lost_blocks == 1);
  }
  CHECK(b.count("connections") == cycles + 1);
}

TEST_CASE("data that a slow consumer does not read stay in the USB tagger") {
  Bench b;
  b.connect();
  // 90 MiB are more than the limit for queued bytes.
  constexpr std::size_t runs = 90, per_run = 65'536;
  for (std::size_t i = 0; i < runs; ++i) b.device.send(b.tags(per_run));
  std::uint64_t fetched = 1, before = 0;
  for (; fetched != before; fetched = b.device.fetched()) {
    before = fetched;
    std::this_thread::sleep_for(500ms);
  }
  CHECK(fetched > 60u << 20);
  CHECK(fetched < 70u << 20);
  REQUIRE(b.arrived(runs * per_run));
  b.check_times({{1, b.sent}});
  CHECK(b.lost_blocks() == 0);
}

TEST_CASE("a USB tagger that cannot be opened is reported in one line") {
  // Starts a driver. Returns its only event.
  const auto refusal = [](Bench& b, const std::string& at) {
    KeepingSink sink;
    const auto refused = make_tdc(b.loop, {at});
    refused->start(sink);
    REQUIRE(run_until(b.loop, [&] { return sink.state() == DeviceState::faulted; }));
    REQUIRE(sink.events.size() == 1);
    return sink.events[0];
  };
  {
    Bench other(0);
    CHECK_THAT(refusal(other, address), Catch::Contains("the device has no interface for blocks"));
  }
  Bench b;
  CHECK(refusal(b, "usb:1209:0001:T2") ==
        "usb:1209:0001:T2: cannot open; only T1 is attached: No such device");
  b.device.unplug();
  CHECK(refusal(b, address) == std::string(address) + ": cannot open: No such device");
  b.device.plug();
  {
    auto identity = Bench::identity("T0");
    identity.number = 4;
    sim::UsbDevice other(b.bed, identity, [&](const auto& setup) { return b.control(setup); });
    other.plug();
    CHECK_THAT(refusal(b, "usb:1209:0001"),
               Catch::Contains("the address matches several devices (") && Catch::Contains("T0") &&
                   Catch::Contains("T1"));
    CHECK(b.starts == 0);
    other.unplug();
  }
  b.connect();
  CHECK_THAT(refusal(b, address), Catch::Contains("in use by another program"));
  b.device.send(b.tags(1));
  CHECK(b.arrived(1));
}

// SPDX-License-Identifier: MIT
// Tests the unmodified USB tagger driver and libusb with a device emulated below usbfs.
#include "../catch.hpp"
#include "../drivers/blocks.hpp"
#include "../drivers/sink.hpp"
#include "drivers/inventory/inventory.hpp"
#include "drivers/make_driver.hpp"
#include "tests/emulation/tdc_usb.hpp"

using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

constexpr char address[] = "usb:1209:0001:T1";

// Simulates a USB tagger that sends the blocks given by the test.
struct Bench {
  Bench()
      : device(bed,
               {.vendor = 0x1209,
                .product = 1,
                .release_bcd = 0x0203,
                .manufacturer = "Maker",
                .name = "Tagger",
                .serial = "T1",
                .interface_subclass = subclass,
                .interface_protocol = 1},
               [this](const sim::UsbDevice::Setup& setup) { return control(setup); }) {
    device.plug();
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
    sequence = 0;
    device.send(hello_block(sequence++));
    REQUIRE(run_until(loop, [&] { return sink.state() == DeviceState::streaming; }));
  }
  // Returns a block of `count` tags. Each tag has a time 1 ps later than the previous tag.
  Bytes tags(std::size_t count) {
    Bytes payload;
    for (std::size_t i = 0; i < count; ++i) put(payload, Tag{.channel = 2, .time_ps = ++sent});
    return test::make_block(bridge::BlockKind::tags, sequence++, payload);
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

  static inline std::uint8_t subclass = 0x45;
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

// Simulated tagger of the laboratory, with a FIFO of `fifo_bytes`.
struct Simulated {
  explicit Simulated(std::size_t fifo_bytes = sim::TdcOptions{}.send_queue_bytes) {
    options.window_s = 0.5;
    options.send_queue_bytes = fifo_bytes;
    tagger = sim::make_tdc_usb(loop, player, bed, options);
    driver = make_tdc(loop, {tagger->address()});
    driver->start(sink);
  }
  std::uint64_t sent(std::size_t what) const { return tagger->sent().at(what).second; }

  sim::UsbBed bed;
  port::SystemLoop loop;
  sim::Conditions conditions;
  sim::ScenePlayer player{loop, conditions, {}};
  sim::TdcOptions options;
  std::unique_ptr<sim::TdcUsb> tagger;
  KeepingSink sink;
  std::unique_ptr<Driver> driver;
};

}  // namespace

TEST_CASE("a USB tagger is found, started, read and stopped") {
  Bench b;
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

TEST_CASE("the device list finds a USB tagger by its interface") {
  Bench b;
  const auto list = inventory::list_attached();
  REQUIRE(list.size() == 1);
  CHECK(list[0].kind == "USB time tagger");
  CHECK(list[0].nodes.at(0).key == "tdc.address");
  CHECK(list[0].nodes.at(0).address == address);
}

TEST_CASE("all tags of a simulated USB tagger are received") {
  Simulated s;
  REQUIRE(run_until(s.loop, [&] { return s.sent(0) > 500'000; }));
  s.tagger->stop();
  CHECK(run_until(s.loop, [&] { return s.sink.tags.size() == s.sent(0); }));
  CHECK(s.sink.info.serial == "SIM-USB-1");
  CHECK(counter(*s.driver, "junk_bytes") == 0);
  CHECK(std::is_sorted(s.sink.tags.begin(), s.sink.tags.end(),
                       [](const Tag& a, const Tag& b) { return a.time_ps < b.time_ps; }));
}

TEST_CASE("a USB tagger with a full FIFO reports its lost tags") {
  Simulated s(22'000);  // The FIFO of 22 kB holds about the data of one transfer.
  CHECK(run_until(s.loop, [&] { return s.sent(1) > 0 && counter(*s.driver, "lost_items") > 0; }));
  CHECK(counter(*s.driver, "lost_items") <= s.sent(1));
  CHECK(s.sink.state() == DeviceState::streaming);
}

TEST_CASE("no tags are lost if USB transfers split blocks or if packets are short or empty") {
  Bench b;
  b.connect();
  const Bytes all = join({b.tags(50'000), b.tags(0), b.tags(50'000)});
  // Pieces of 37 000 bytes end in the middle of tags, and the long run of packets fills entire
  // transfers.
  const ByteView wire = all;
  for (std::size_t at = 0; at < wire.size(); at += 37'000)
    b.device.send_more(wire.subspan(at, std::min<std::size_t>(37'000, wire.size() - at)));
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
  std::string expected;
  SECTION("a lost byte in a USB block is reported once") {
    Bytes run = b.tags(5);
    run.erase(run.begin() + 40);
    b.device.send(join({run, b.tags(5)}));
    expected = "the block has a wrong checksum";
  }
  SECTION("a halted USB endpoint is reported once") {
    b.device.halt();
    expected = std::string(address) + ": endpoint halted: Broken pipe";
  }
  REQUIRE(b.faulted());
  CHECK(b.sink.events == std::vector<std::string>{expected});
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
    b.device.send_more(cut);  // the last bytes wait in an incomplete transfer
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
  const auto refusal = [](Bench& b, const char* at) {
    b.driver = make_tdc(b.loop, {at});
    b.driver->start(b.sink);
    REQUIRE(b.faulted());
    b.driver->stop();
    REQUIRE(b.sink.events.size() == 1);
    return b.sink.events[0];
  };
  SECTION("a USB tagger with another serial number is reported") {
    Bench b;
    CHECK(refusal(b, "usb:1209:0001:T2") ==
          "usb:1209:0001:T2: cannot open; only T1 is attached: No such device");
  }
  SECTION("a missing USB tagger is reported") {
    Bench b;
    b.device.unplug();
    CHECK(refusal(b, address) == std::string(address) + ": cannot open: No such device");
  }
  SECTION("two USB taggers without a configured serial number are reported") {
    Bench b;
    sim::UsbDevice other(b.bed,
                         {.vendor = 0x1209,
                          .product = 1,
                          .manufacturer = "Maker",
                          .name = "Tagger",
                          .serial = "T0",
                          .interface_subclass = 0x45,
                          .interface_protocol = 1,
                          .number = 4},
                         [&](const sim::UsbDevice::Setup& setup) { return b.control(setup); });
    other.plug();
    CHECK_THAT(refusal(b, "usb:1209:0001"),
               Catch::Contains("the address matches several devices (") && Catch::Contains("T0") &&
                   Catch::Contains("T1"));
    CHECK(b.starts == 0);
    b.sink = {};
    b.connect();
    b.driver.reset();
  }
  SECTION("a USB device of another type is reported") {
    Bench::subclass = 0;
    Bench b;
    Bench::subclass = 0x45;
    CHECK_THAT(refusal(b, address), Catch::Contains("the device has no interface for blocks"));
  }
  SECTION("a USB tagger in use by another program is reported") {
    Bench b;
    b.connect();
    auto second = make_tdc(b.loop, {address});
    KeepingSink sink;
    second->start(sink);
    REQUIRE(run_until(b.loop, [&] { return sink.state() == DeviceState::faulted; }));
    CHECK_THAT(sink.events.at(0), Catch::Contains("in use by another program"));
    second->stop();
    b.device.send(b.tags(1));
    CHECK(b.arrived(1));
  }
}

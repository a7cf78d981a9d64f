// SPDX-License-Identifier: MIT
// The USB time tagger: the unmodified driver and libusb, the device emulated below usbfs.
#include <boost/asio/io_context.hpp>
#include <catch2/catch.hpp>
#include <cstring>

#include "../drivers/sink.hpp"
#include "drivers/inventory/inventory.hpp"
#include "drivers/make_driver.hpp"
#include "drivers/tdc/usb_protocol.hpp"
#include "tests/emulation/tdc_usb.hpp"

using namespace echofuse;
using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

constexpr char address[] = "usb:1209:0001:T1";

// A tagger that sends what the test tells it to.
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
    Bytes answer;
    if (setup.request == 1) {
      put(answer, version.load());
      put(answer, std::uint16_t{16});
      put(answer, std::uint32_t{1000});
      put(answer, std::uint64_t{0});
    } else if (setup.request == 2) {
      put(answer, std::uint64_t{1});
      put(answer, std::uint64_t{0});
      put(answer, std::uint64_t{42});
    } else if (setup.request == 3) {
      ++starts;
    } else if (setup.request == 4) {
      ++stops;
    } else {
      return std::nullopt;
    }
    return answer;
  }

  void connect() {
    driver = make_tdc(io, {address}, clock);
    driver->start(sink);
    REQUIRE(run_until(io, [&] { return sink.state() == DeviceState::streaming; }));
  }
  // Tags 1, 2, 3 ... on the wire, the k-th with time k.
  Bytes tags(std::size_t count) {
    Bytes bytes;
    for (std::size_t i = 0; i < count; ++i) {
      Tag tag;
      tag.channel = 2;
      tag.time_ps = ++sent;
      put(bytes, tag);
    }
    return bytes;
  }
  bool arrived(std::size_t count) {
    return run_until(io, [&] { return sink.tags.size() >= count; });
  }
  // All tags that came are `expected`, in order.
  void check_times(const std::vector<std::int64_t>& expected) const {
    std::vector<std::int64_t> times;
    for (const Tag& tag : sink.tags) times.push_back(tag.time_ps);
    CHECK(times == expected);
  }
  std::uint64_t lost_blocks() const {
    std::uint64_t all = 0;
    for (const auto& block : sink.blocks) all += block.lost_blocks;
    return all;
  }
  std::uint64_t count(const char* name) const { return counter(*driver, name); }
  bool counted(const char* name, std::uint64_t value) {
    return run_until(io, [&] { return count(name) == value; });
  }

  static inline std::uint8_t subclass = 0x45;
  sim::UsbBed bed;
  std::atomic<std::uint16_t> version{1};
  std::atomic<int> starts{0}, stops{0};
  sim::UsbDevice device;
  const SystemClock clock;
  boost::asio::io_context io;
  KeepingSink sink;
  std::int64_t sent = 0;
  std::unique_ptr<Driver> driver;
};

std::vector<std::int64_t> range(std::int64_t first, std::int64_t last) {
  std::vector<std::int64_t> all;
  for (std::int64_t i = first; i <= last; ++i) all.push_back(i);
  return all;
}

}  // namespace

TEST_CASE("a USB tagger is found, started, read and stopped") {
  Bench b;
  b.connect();
  CHECK(b.sink.info.model == "Maker Tagger");
  CHECK(b.sink.info.serial == "T1");
  CHECK(b.sink.info.firmware == "2.03");
  CHECK(b.starts == 1);
  b.device.send(b.tags(10));
  REQUIRE(b.arrived(10));
  b.check_times(range(1, 10));
  CHECK(b.lost_blocks() == 0);
  CHECK(b.counted("device_lost", 42));
  CHECK(b.counted("tags", 10));
  b.driver.reset();
  CHECK(b.stops == 1);
  CHECK_FALSE(b.device.claimed());
}

TEST_CASE("the listing finds a USB tagger by its interface") {
  Bench b;
  const auto list = inventory::list_attached();
  REQUIRE(list.size() == 1);
  CHECK(list[0].kind == "USB time tagger");
  CHECK(list[0].nodes.at(0).key == "tdc.address");
  CHECK(list[0].nodes.at(0).address == address);
}

TEST_CASE("all tags of the simulated device arrive") {
  sim::UsbBed bed;
  const SystemClock clock;
  boost::asio::io_context io;
  sim::Conditions conditions;
  sim::ScenePlayer player(clock, conditions, {});
  sim::TdcOptions options;
  options.window_s = 0.5;
  const auto tagger = sim::make_tdc_usb(io, player, bed, options);
  const auto tags_sent = [&] { return tagger->sent().at(0).second; };
  KeepingSink sink;
  const auto driver = make_tdc(io, {tagger->address()}, clock);
  driver->start(sink);
  REQUIRE(run_until(io, [&] { return tags_sent() > 500'000; }));
  tagger->stop();
  CHECK(run_until(io, [&] { return sink.tags.size() == tags_sent(); }));
  CHECK(counter(*driver, "junk_bytes") == 0);
  CHECK(std::is_sorted(sink.tags.begin(), sink.tags.end(),
                       [](const Tag& a, const Tag& b) { return a.time_ps < b.time_ps; }));
}

TEST_CASE("a device whose memory is full says what it lost, in the stream") {
  sim::UsbBed bed;
  const SystemClock clock;
  boost::asio::io_context io;
  sim::Conditions conditions;
  sim::ScenePlayer player(clock, conditions, {});
  sim::TdcOptions options;
  options.window_s = 0.5;
  options.send_queue_bytes = 22'000;  // about what it makes between two runs
  const auto tagger = sim::make_tdc_usb(io, player, bed, options);
  KeepingSink sink;
  const auto driver = make_tdc(io, {tagger->address()}, clock);
  driver->start(sink);
  const auto total = [&](TagType type) {
    std::uint64_t n = 0;
    for (const Tag& tag : sink.tags)
      n += tag.type != type ? 0u : type == TagType::missed_events ? tag.missed_events : 1u;
    return n;
  };
  const auto lost = [&] { return tagger->sent().at(1).second; };
  CHECK(run_until(io, [&] { return lost() > 0 && total(TagType::missed_events) == lost(); }));
  CHECK(total(TagType::overflow_begin) > 0);
  CHECK(total(TagType::overflow_begin) == total(TagType::overflow_end));
}

TEST_CASE("records may be cut anywhere between transfers, short and empty packets are no loss") {
  Bench b;
  b.connect();
  const Bytes all = b.tags(100'000);
  // 37 KiB pieces end in the middle of records, and the long run fills whole transfers.
  const ByteView wire = all;
  for (std::size_t at = 0; at < wire.size(); at += 37'000)
    b.device.send_more(wire.subspan(at, std::min<std::size_t>(37'000, wire.size() - at)));
  b.device.send({});
  REQUIRE(b.arrived(100'000));
  for (std::size_t n : {1u, 32u, 31u, 33u, 0u, 0u, 16'384u}) b.device.send(b.tags(n));
  const auto total = static_cast<std::size_t>(b.sent);
  REQUIRE(b.arrived(total));
  b.check_times(range(1, b.sent));
  CHECK(b.lost_blocks() == 0);
  CHECK(b.counted("tags", total));
  CHECK(b.count("junk_bytes") == 0);
}

TEST_CASE("a lost byte costs the rest of its run, and no more") {
  Bench b;
  b.connect();
  b.device.send(b.tags(100));
  Bytes run = b.tags(100);
  run.erase(run.begin() + 40 * 16 + 3);  // in the 41st record
  b.device.send(run);
  b.device.send(b.tags(100));
  REQUIRE(b.arrived(240));
  auto expected = range(1, 140);
  const auto rest = range(201, 300);
  expected.insert(expected.end(), rest.begin(), rest.end());
  b.check_times(expected);
  CHECK(b.lost_blocks() == 1);
  CHECK(b.counted("junk_bytes", 60 * 16 - 1));
  CHECK(b.count("gaps") == 1);
}

TEST_CASE("garbage and a run that ends in mid-record are counted, byte for byte") {
  Bench b;
  b.connect();
  Bytes garbage(1000, 0xa5);
  b.device.send(garbage);
  Bytes cut = b.tags(3);
  cut.resize(cut.size() - 5);
  b.device.send(cut);
  b.device.send(b.tags(1));
  REQUIRE(b.arrived(3));
  b.check_times({1, 2, 4});
  CHECK(b.counted("junk_bytes", 1000 + 11));
  CHECK(b.count("gaps") == 2);
  CHECK(b.count("bytes") == b.count("tags") * 16 + b.count("junk_bytes"));
}

TEST_CASE("a stalled endpoint is cleared, and the gap is told") {
  Bench b;
  b.connect();
  b.device.send(b.tags(5));
  REQUIRE(b.arrived(5));
  b.device.halt();
  REQUIRE(b.counted("stalls", 1));
  b.device.send(b.tags(5));
  REQUIRE(b.arrived(10));
  CHECK(b.sink.blocks.back().lost_blocks == 1);
  CHECK(b.sink.state() == DeviceState::streaming);
}

TEST_CASE("unplugged in mid-transfer and plugged in again") {
  Bench b;
  b.connect();
  const std::size_t cycles = std::getenv("ECHOFUSE_LONG") ? 100 : 3;
  for (std::size_t i = 1; i <= cycles; ++i) {
    Bytes cut = b.tags(1000);
    cut.resize(cut.size() - 5);
    b.device.send_more(cut);  // waits in a transfer that is not full
    b.device.unplug();
    REQUIRE(run_until(b.io, [&] { return b.sink.state() == DeviceState::faulted; }));
    const std::size_t before = b.sink.tags.size();
    CHECK(before == i * 999 + (i - 1) * 4);
    b.device.plug();
    b.device.send(b.tags(4));  // is there before the start is over
    REQUIRE(run_until(b.io, [&] { return b.sink.state() == DeviceState::streaming; }));
    REQUIRE(b.arrived(before + 4));
    CHECK(b.sink.tags.back().time_ps == b.sent);
    CHECK(b.sink.blocks.back().lost_blocks == 1);
  }
  CHECK(b.sink.tags.size() == (999 + 4) * cycles);
  CHECK(b.counted("junk_bytes", 11 * cycles));
  CHECK(b.counted("connections", cycles + 1));
}

TEST_CASE("a silent device is opened again, its empty packets are signs of life") {
  Bench b;
  b.connect();
  const auto until = std::chrono::steady_clock::now() + 4s;
  while (std::chrono::steady_clock::now() < until) {
    b.device.send({});
    run_for(b.io, 100ms);
  }
  CHECK(b.sink.state() == DeviceState::streaming);
  REQUIRE(run_until(b.io, [&] { return b.sink.state() == DeviceState::faulted; }));
  CHECK(b.sink.events ==
        std::vector<std::string>{"the device sent neither tags nor empty runs for 3 s"});
  REQUIRE(run_until(b.io, [&] { return b.sink.state() == DeviceState::streaming; }));
  CHECK(b.starts == 2);
}

TEST_CASE("junk is no sign of life") {
  Bench b;
  b.connect();
  REQUIRE(run_until(b.io, [&] {
    b.device.send(Bytes{1});
    run_for(b.io, 100ms);
    return b.sink.state() == DeviceState::faulted;
  }));
  CHECK(b.sink.tags.empty());
}

TEST_CASE("a slow consumer loses tags, and every one is counted") {
  Bench b;
  b.connect();
  constexpr std::size_t runs = 90, per_run = 65'536;  // 90 MiB: more than may be on its way
  for (std::size_t i = 0; i < runs; ++i) b.device.send(b.tags(per_run));
  const auto patience = std::chrono::steady_clock::now() + 30s;
  while (b.device.fetched() < runs * per_run * 16 && std::chrono::steady_clock::now() < patience)
    std::this_thread::sleep_for(10ms);  // the io thread stands still meanwhile
  b.device.send(b.tags(1));
  REQUIRE(run_until(b.io,
                    [&] { return !b.sink.tags.empty() && b.sink.tags.back().time_ps == b.sent; }));
  std::uint64_t lost = 0;
  for (const auto& block : b.sink.blocks) lost += block.lost_items;
  CHECK(lost > 0);
  CHECK(b.sink.tags.size() + lost == static_cast<std::size_t>(b.sent));
  CHECK(b.counted("lost_items", lost));
}

TEST_CASE("what keeps a tagger from being used is said in one line") {
  const auto refusal = [](Bench& b, const char* at) {
    b.driver = make_tdc(b.io, {at}, b.clock);
    b.driver->start(b.sink);
    REQUIRE(run_until(b.io, [&] { return b.sink.state() == DeviceState::faulted; }));
    b.driver->stop();
    return b.sink.events.at(0);
  };
  SECTION("another serial number") {
    Bench b;
    CHECK(refusal(b, "usb:1209:0001:T2") == "only one with serial T1 is attached");
  }
  SECTION("not there") {
    Bench b;
    b.device.unplug();
    CHECK(refusal(b, address) == "no such device is attached");
  }
  SECTION("two, and no serial number") {
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
    CHECK_THAT(refusal(b, "usb:1209:0001"), Catch::StartsWith("the address fits several (") &&
                                                Catch::Contains("T0") && Catch::Contains("T1"));
    CHECK(b.starts == 0);
    b.sink = {};
    b.connect();
    CHECK(b.sink.info.serial == "T1");
    b.driver.reset();
  }
  SECTION("another protocol version") {
    Bench b;
    b.version = 2;
    CHECK_THAT(refusal(b, address), Catch::Contains("another version"));
  }
  SECTION("another kind of device") {
    Bench::subclass = 0;
    Bench b;
    Bench::subclass = 0x45;
    CHECK_THAT(refusal(b, address), Catch::Contains("no interface for tags"));
  }
  SECTION("in use") {
    Bench b, *first = &b;
    first->connect();
    auto second = make_tdc(b.io, {address}, b.clock);
    KeepingSink sink;
    second->start(sink);
    REQUIRE(run_until(b.io, [&] { return sink.state() == DeviceState::faulted; }));
    CHECK_THAT(sink.events.at(0), Catch::Contains("another program uses it"));
    second->stop();
    b.device.send(b.tags(1));
    CHECK(b.arrived(1));
  }
}

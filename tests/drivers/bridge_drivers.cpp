// SPDX-License-Identifier: MIT
// Tests bridge drivers in virtual time, also with bridges that stop sending, send wrong lengths,
// close the connection and accept a new one. Two cases use real TCP connections.
#include <deque>

#include "../catch.hpp"
#include "../fixtures/wire.hpp"
#include "blocks.hpp"
#include "drivers/make_driver.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "sink.hpp"

using namespace std::chrono_literals;
using bridge::BlockKind;
using bridge::make_block;
using test::depth_block;
using test::hello_block;
using test::run_until;
using test::tags_block;

namespace {

using Numbers = std::vector<std::uint64_t>;
using Texts = std::vector<std::string>;
using enum DeviceState;

constexpr char address[] = "bridge:tcp://bridge:1";

// Driver of a sensor, together with its bridge.
struct Bench {
  explicit Bench(Sensor sensor) : kind(sensor) {
    listener.start({.connected = [this] { ++clients, connected = true; },
                    .left = [this] { connected = false; }});
    loop.ports[address] = listener.opener();
    RadarConfig radar;
    radar.address = address;
    driver = sensor == Sensor::spd     ? make_tdc(loop, {address})
             : sensor == Sensor::depth ? make_depth(loop, {address})
                                       : make_radar(loop, radar);
    driver->start(sink);
  }
  // Waits for the next connection of the driver.
  void accept() {
    listener.accept();
    const int before = clients;
    REQUIRE(run_until(loop, [&] { return clients > before; }));
  }
  // Sends the blocks at once, and waits until they have arrived.
  void send(const std::vector<Bytes>& blocks) {
    sent.push_back(test::join(blocks));
    listener.write(sent.back(), [](bool) {});
    loop.run_for(1ms);
  }
  void reconnect() {
    listener.hang_up();
    accept();
  }
  Bytes block(std::uint32_t n) const {
    return kind == Sensor::spd ? tags_block(n) : depth_block(n, n);
  }
  Numbers delivered() const {
    Numbers numbers;
    for (const Tag& tag : sink.tags) numbers.push_back(static_cast<std::uint64_t>(tag.time_ps));
    for (const DepthFrame& frame : sink.depth) numbers.push_back(frame.frame_number);
    return numbers;
  }
  std::uint64_t lost() const {
    std::uint64_t sum = 0;
    for (const TagBlock& b : sink.blocks) sum += b.lost_blocks + b.lost_items;
    for (const DepthFrame& frame : sink.depth) sum += frame.lost_before;
    return sum;
  }
  std::uint64_t count(const char* name) const { return test::counter(*driver, name); }

  Sensor kind;
  port::VirtualLoop loop;
  test::KeepingSink sink;
  test::MemoryListener listener{loop};
  std::deque<Bytes> sent;
  int clients = 0;
  bool connected = false;
  std::vector<Bytes> golden = test::read_golden("bridge.hex");
  std::vector<Bytes> sensors = test::read_golden("bridge_sensors.hex");
  std::unique_ptr<Driver> driver;
};

}  // namespace

TEST_CASE("the tagger driver receives tags from a bridge and reports each connection") {
  Bench b(Sensor::spd);
  CHECK(b.sink.state() == connecting);
  b.accept();
  const HostTime sent = b.loop.now();
  b.send({b.golden[0], b.golden[1]});
  CHECK(b.sink.state() == streaming);
  CHECK(std::vector{b.sink.info.model, b.sink.info.serial, b.sink.info.firmware} ==
        std::vector<std::string>{"Time Tagger Ultra", "1808000BBV", "2.10"});
  CHECK(b.sink.info.address == address);
  REQUIRE(b.sink.blocks.size() == 1);
  CHECK(b.sink.blocks[0].lost_blocks == 0);
  CHECK(b.sink.blocks[0].received == sent);
  CHECK(b.delivered().at(1) == 1'013'443);
  CHECK(b.count("tags") == 4);

  SECTION("a goodbye block ends the bridge connection") {
    b.send({b.golden[3], b.golden[1]});
    CHECK(b.sink.state() == faulted);
    CHECK(b.sink.events == Texts{"bridge closed the connection: device unplugged, or another "
                                 "client connected"});
    CHECK(b.count("tags") == 4);
  }
  SECTION("the tagger driver reports no event after stop()") {
    b.driver->stop();
    const std::size_t calls = b.sink.calls();
    b.send({b.golden[1]});
    b.loop.run_for(10s);
    CHECK(b.sink.calls() == calls);
  }
}

TEST_CASE("blocks of another kind are reported once, and as lost with the next data") {
  const std::string port = "check the port in its address";
  const auto [kind, what] = GENERATE_COPY(table<BlockKind, std::string>(
      {{BlockKind::depth, "depth frames, not tags; " + port},
       {BlockKind::range_profile, "range profiles, not tags; " + port},
       {BlockKind::histogram,
        "histograms, not tags; add \"sends\": \"histograms\" to its hello block"}}));
  Bench b(Sensor::spd);
  b.accept();
  b.send(
      {hello_block(), make_block(kind, 1, 5, {}), make_block(kind, 2, 0, {}), tags_block(5, 1, 7)});
  CHECK(b.sink.events == Texts{"this bridge sends " + what});
  CHECK(b.sink.blocks.at(0).lost_blocks == 4);
  CHECK(b.sink.blocks[0].lost_items == 12);
  CHECK(b.count("bad_payloads") == 2);
  CHECK(b.count("lost_blocks") == 2);
  CHECK(b.count("lost_items") == 12);
}

TEST_CASE("a server that sends damaged blocks or none is reported once and connected again") {
  Bytes damaged = tags_block(1);
  damaged.back() ^= 1;
  const auto [text, why] = GENERATE_COPY(table<Bytes, std::string>(
      {{{'S', 'S', 'H', '-', '2', '.', '0', '\r', '\n'},
        "the received bytes are not a bridge block; expected an echofuse bridge"},
       {hello_block("[1]"),
        "the hello block is not valid: expected a JSON object with model, serial and firmware"},
       {test::join({hello_block(), damaged, tags_block(2)}), "the block has a wrong checksum"}}));
  Bench b(Sensor::spd);
  for (int round = 1; round <= 2; ++round) {
    b.accept();
    b.send({text});
    CHECK_FALSE(b.connected);
    CHECK(b.sink.events == Texts{why});
    CHECK(b.sink.state() == faulted);
  }
  b.accept();
  b.send({hello_block(), tags_block(4), tags_block(5)});
  CHECK(b.delivered() == Numbers{4, 5});
  CHECK(b.lost() > 0);
  CHECK(b.sink.state() == streaming);
  CHECK(b.sink.events.size() == 1);
  CHECK(b.count("connections") == 3);
}

TEST_CASE("the camera driver receives depth frames and axes from a bridge") {
  Bench b(Sensor::depth);
  b.accept();
  b.send({b.golden[0]});
  CHECK(b.sink.state() == connecting);  // until the first frame arrives
  const HostTime sent = b.loop.now();
  b.send({b.golden[2], make_block(BlockKind::depth, 3, 0, test::payload_of(b.golden[2]))});
  CHECK(b.sink.states == std::vector{connecting, streaming});
  REQUIRE(b.sink.info.axes.size() == 2);
  CHECK(b.sink.info.axes[0].name == "depth_x");
  CHECK(b.sink.info.axes[1].step == -0.5);
  CHECK(b.sink.info.model == "Time Tagger Ultra");
  REQUIRE(b.sink.depth.size() == 2);
  CHECK(b.sink.depth[0].depth_mm == std::vector<std::uint16_t>{0, 1000, 2000, 3000, 4000, 0});
  CHECK(b.sink.depth[0].received == sent);
  // The bridge dropped 5 frames, and block 1 is missing, so 6 frames are lost.
  CHECK(b.sink.depth[0].lost_before == 6);
  CHECK(b.count("frames") == 2);
  b.send({b.golden[1]});
  CHECK(b.count("bad_payloads") == 1);
}

TEST_CASE(
    "lost camera frames are counted by the frame index and by the bridge, even across a "
    "reconnection") {
  Bench b(Sensor::depth);
  b.accept();
  // Frames 8 and 9 were lost before frame 10.
  b.send({hello_block(), depth_block(1, 7), depth_block(2, 10)});
  b.reconnect();
  b.send({hello_block(), depth_block(1, 40), depth_block(4, 43)});
  b.reconnect();
  // The restart of the frame index shows that at least one frame was lost. The header of each block
  // states the number of frames that the bridge dropped before it numbered them.
  b.send({hello_block(), depth_block(1, 1), depth_block(2, 2, 5), depth_block(3, 3),
          depth_block(4, 6, 1)});
  // The longest plausible gap in the frame index has 2^20 - 1 frames.
  b.send({depth_block(5, 6 + (1 << 20)), depth_block(6, 7 + (2 << 20))});
  Numbers lost;
  for (const DepthFrame& frame : b.sink.depth) lost.push_back(frame.lost_before);
  CHECK(lost == Numbers{0, 2, 29, 2, 1, 5, 0, 2, (1 << 20) - 1, 0});
  CHECK(b.count("lost_frames") == 40 + (1 << 20));
}

TEST_CASE("the counting-board driver receives histograms and their axis from a bridge") {
  Bench b(Sensor::spd);
  const ByteView counts = test::payload_of(b.sensors[1]);
  const auto histogram = [](std::uint32_t number, ByteView payload, std::uint64_t dropped = 0) {
    return make_block(BlockKind::histogram, number, dropped, payload);
  };
  b.accept();
  b.send({b.sensors[0]});
  CHECK(b.sink.state() == connecting);  // until the first histogram arrives
  SECTION("lost histograms are counted by block number") {
    const HostTime sent = b.loop.now();
    b.send({b.sensors[1], histogram(4, counts, 3)});
    CHECK(b.sink.state() == streaming);
    CHECK(b.sink.info.serial == "B7");
    REQUIRE(b.sink.info.axes.size() == 1);
    CHECK(b.sink.info.axes[0].step == 92.5);
    REQUIRE(b.sink.histograms.size() == 2);
    CHECK(b.sink.histograms[0].lost_before == 0);
    CHECK(b.sink.histograms[0].received == sent);
    // The bridge dropped 3 histograms, and blocks 2 and 3 are missing, so 5 histograms are lost.
    CHECK(b.sink.histograms[1].lost_before == 5);
    CHECK(b.count("histograms") == 2);
    CHECK(b.count("lost_histograms") == 5);
  }
  Bytes zones(counts.begin(), counts.end());
  zones[0] = 5, zones[4] = 1;  // 5 zones of 1 bin each
  SECTION("zones without directions in the hello block have unknown directions") {
    b.send({histogram(1, zones)});
    CHECK(b.sink.info.axes.at(0).zones == Zones(5));
    CHECK(b.sink.info.axes[0].count == 1);
    CHECK(b.sink.histograms.at(0).counts.size() == 5);
  }
  SECTION("zones are read from the hello block, and a different number of histograms is refused") {
    b.reconnect();
    b.sink.events.clear();  // removes the warning about the lost connection
    b.send({hello_block(R"({"sends": "histograms",
                "zones": [{"x": -0.1, "y": 0, "width": 0.2, "zero_ps": 7.5}]})"),
            histogram(1, zones), histogram(2, zones)});
    CHECK(b.count("bad_payloads") == 2);
    CHECK(b.sink.events == Texts{"its histograms have 5 zones, but the hello block lists 1"});
    CHECK(b.sink.histograms.empty());
    b.send({histogram(3, counts)});
    CHECK(b.sink.info.axes.at(0).zones == Zones{{-0.1, 0, 0.2, 7.5}});
  }
}

TEST_CASE("the radar driver receives range profiles from a bridge") {
  Bench b(Sensor::radar);
  Bytes later(b.sensors[2].begin() + bridge::header_bytes, b.sensors[2].end());
  later[4] = 45;  // changes the frame number to 45; the number of the first frame is 42
  b.accept();
  const HostTime sent = b.loop.now();
  b.send({b.sensors[0], b.sensors[2], make_block(BlockKind::range_profile, 3, 0, later)});
  CHECK(b.sink.state() == streaming);
  CHECK(b.sink.info.sensor == Sensor::radar);
  CHECK(b.sink.info.axes.at(0).quantity == "power");
  REQUIRE(b.sink.radar.size() == 2);
  CHECK(b.sink.radar[0].power == std::vector<float>{1, 0, 2.5F, 1e9F});
  CHECK(b.sink.radar[0].received == sent);
  CHECK(b.sink.radar[1].lost_before == 2);  // frames 43 and 44 were lost
}

TEST_CASE(
    "the driver reconnects if a bridge stalls, sends a wrong length or omits the hello block") {
  Bench b(Sensor::spd);
  const std::string what = GENERATE("silent", "slow", "wrong length", "no hello");
  CAPTURE(what);
  const bool greets = what != "no hello";
  b.accept();
  const HostTime begin = b.loop.now();
  b.send({greets ? hello_block() : Bytes{}, b.block(1)});
  CHECK(b.delivered().size() == greets);
  const Bytes drip = b.block(2);
  Bytes too_long = drip;
  too_long[14] = 0xff;  // sets the payload length to about 16 MiB
  if (what == "wrong length") b.send({too_long, b.block(3), b.block(4)});
  b.listener.accept();
  const auto back = [&] { return b.clients == 2; };
  for (std::size_t at = 0; at < drip.size() && !run_until(b.loop, back, 1s); ++at)
    if (what == "slow") b.send({{drip[at]}});
  // The driver gives up after four checks in a row without a block and reconnects 0.1 s later. The
  // checks are 1 s apart. After a hello block, the first check succeeds, so the driver gives up 1 s
  // later.
  CHECK(seconds(b.loop.now() - begin) == Approx(greets ? 5.1 : 4.1).margin(0.01));
  b.send({hello_block(), b.block(1), b.block(2)});
  CHECK(b.delivered().size() == (greets ? 3 : 2));
  // If the hello block is missing, it also counts as lost, and so does the data block that follows
  // it.
  CHECK(b.lost() == (greets ? 1 : 3));
  CHECK(b.count("connections") == 2);
  CHECK(b.sink.events == Texts{greets ? "no block received for 4 s"
                                      : "no hello block within 4 s; expected an echofuse bridge"});
}

TEST_CASE("the bridge driver reconnects after each of 100 disconnections") {
  Bench b(GENERATE(Sensor::spd, Sensor::depth));
  b.accept();
  HostTime longest{};
  for (std::size_t round = 1; round <= 100; ++round) {
    b.send({hello_block(), b.block(1), {'E', 'F', 'B'}});
    CHECK(b.delivered().size() == round);
    const HostTime begin = b.loop.now();
    b.reconnect();
    longest = std::max(longest, b.loop.now() - begin);
  }
  CHECK(longest == 2s);  // longest delay between connection attempts
  // One block was lost before each of the last 99 connections that delivered data.
  CHECK(b.lost() == 99);
  CHECK(b.clients == 101);
  CHECK(b.count("junk_bytes") == 300);  // the beginning of a block in each connection
  CHECK(b.count("connections") == 101);
}

TEST_CASE("an unreachable bridge is retried over TCP, but reported only once") {
  port::SystemLoop loop;
  test::KeepingSink sink;
  const auto listener = sim::make_tcp_listener(loop, 0);
  bool connected = false;
  listener->start({.connected = [&] { connected = true; }, .left = [] {}});
  listener->plug(false);
  const auto driver = make_tdc(loop, {listener->address()});
  driver->start(sink);
  loop.run_for(400ms);
  CHECK(sink.state() == faulted);
  REQUIRE(sink.events.size() == 1);
  CHECK_THAT(
      sink.events[0],
      Catch::StartsWith(listener->address().substr(sizeof "bridge:tcp://" - 1) + ": connect") &&
          Catch::Contains("is its bridge running? Start /") && Catch::EndsWith("/timetagger.py"));
  listener->plug(true);
  listener->accept();
  REQUIRE(run_until(loop, [&] { return connected; }));
  const auto golden = test::read_golden("bridge.hex");
  const Bytes bytes = test::join({golden[0], golden[1]});
  listener->write(bytes, [](bool) {});
  CHECK(run_until(loop, [&] { return sink.tags.size() == 4; }));
}

TEST_CASE("a bridge driver can be destroyed at any time") {
  port::SystemLoop loop;
  test::KeepingSink sink;
  const auto listener = sim::make_tcp_listener(loop, 0);
  for (int steps = 0; steps < 12; ++steps) {
    auto driver = make_tdc(loop, {listener->address()});
    driver->start(sink);
    int left = steps;  // number of further checks of the condition before the loop stops
    loop.run_until([&] { return left-- == 0; }, loop.now() + std::chrono::milliseconds(steps));
    driver.reset();
    loop.run_for(5ms);
  }
}

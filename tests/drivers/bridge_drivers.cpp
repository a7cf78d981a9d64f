// SPDX-License-Identifier: MIT
// Tests bridge drivers over real TCP connections.
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/write.hpp>
#include <optional>

#include "../catch.hpp"
#include "blocks.hpp"
#include "drivers/make_driver.hpp"
#include "sink.hpp"

using boost::asio::ip::tcp;
using test::depth_block;
using test::run_until;

namespace {

// Bridge server that accepts one connection at a time. Only the driver connects to it.
struct Server {
  explicit Server(port::SystemLoop& context, std::uint16_t port = 0)
      : loop(context), acceptor(context.io(), {boost::asio::ip::address_v4::loopback(), port}) {}
  std::string address() const {
    return "bridge:tcp://127.0.0.1:" + std::to_string(acceptor.local_endpoint().port());
  }
  bool accept() {
    client.reset();
    acceptor.async_accept([this](const boost::system::error_code& error, tcp::socket socket) {
      if (!error) client.emplace(std::move(socket));
    });
    return run_until(loop, [this] { return client.has_value(); });
  }
  void send(const Bytes& bytes) { boost::asio::write(*client, boost::asio::buffer(bytes)); }

  port::SystemLoop& loop;
  tcp::acceptor acceptor;
  std::optional<tcp::socket> client;
};

struct Bench {
  void start(std::unique_ptr<Driver> made) {
    driver = std::move(made);
    driver->start(sink);
  }
  // Starts the driver and accepts its connection.
  void connect(std::unique_ptr<Driver> made) {
    start(std::move(made));
    REQUIRE(server.accept());
  }
  template <class Condition>
  bool until(Condition condition) {
    return run_until(loop, condition);
  }
  std::uint64_t count(const char* name) const { return test::counter(*driver, name); }

  port::SystemLoop loop;
  test::KeepingSink sink;
  Server server{loop};
  std::vector<Bytes> golden = test::read_golden("bridge.hex");
  std::vector<Bytes> sensors = test::read_golden("bridge_sensors.hex");
  std::unique_ptr<Driver> driver;
};

}  // namespace

TEST_CASE("the tagger driver receives tags from a bridge and reports each connection") {
  Bench b;
  b.start(make_tdc(b.loop, {b.server.address()}));
  CHECK(b.sink.state() == DeviceState::connecting);
  REQUIRE(b.server.accept());
  const HostTime before = b.loop.now();
  b.server.send(test::join({b.golden[0], b.golden[1]}));
  REQUIRE(b.until([&] { return b.sink.tags.size() == 4; }));
  CHECK(b.sink.state() == DeviceState::streaming);
  CHECK(b.sink.info.model == "Time Tagger Ultra");
  CHECK(b.sink.info.serial == "1808000BBV");
  CHECK(b.sink.info.address == b.server.address());
  CHECK(b.sink.blocks[0].lost_blocks == 0);
  CHECK(b.sink.blocks[0].received >= before);
  CHECK(b.sink.blocks[0].received <= b.loop.now());
  CHECK(b.sink.tags[1].time_ps == 1'013'443);
  CHECK(b.count("tags") == 4);

  SECTION("a depth block is rejected by the tagger driver") {
    b.server.send(b.golden[2]);
    REQUIRE(b.until([&] { return b.count("bad_payloads") == 1; }));
    b.server.send(test::tags_block(3));
    REQUIRE(b.until([&] { return b.sink.blocks.size() == 2; }));
    CHECK(b.sink.blocks[1].lost_blocks == 1);  // the rejected block counts as lost
  }
  SECTION("a goodbye block ends the bridge connection") {
    b.server.send(b.golden[3]);
    REQUIRE(b.until([&] { return b.sink.state() == DeviceState::faulted; }));
    CHECK(b.sink.events ==
          std::vector<std::string>{
              "bridge closed the connection: device unplugged, or another client connected"});
  }
  SECTION("the tagger driver reports no event after stop()") {
    b.server.send(b.golden[1]);
    b.driver->stop();
    const std::size_t calls = b.sink.calls();
    b.loop.run_for(std::chrono::milliseconds(100));
    CHECK(b.sink.calls() == calls);
  }
}

TEST_CASE("the tagger driver reports missing blocks and items with the next data") {
  Bench b;
  b.connect(make_tdc(b.loop, {b.server.address()}));
  // Block 1 (golden[1]) is not sent and counts as lost.
  b.server.send(test::join({b.golden[0], b.golden[2]}));
  REQUIRE(b.until([&] { return b.count("bad_payloads") == 1; }));
  CHECK(b.count("lost_blocks") == 1);
  CHECK(b.sink.blocks.empty());
  CHECK(b.sink.events ==
        std::vector<std::string>{
            "this bridge sends depth frames, not tags; check the port in its address"});
}

TEST_CASE("an unreachable bridge is retried, but reported only once") {
  Bench b;
  std::uint16_t port = 0;
  {
    const Server gone(b.loop);
    port = gone.acceptor.local_endpoint().port();
  }
  b.start(make_tdc(b.loop, {"bridge:tcp://127.0.0.1:" + std::to_string(port)}));
  b.loop.run_for(std::chrono::milliseconds(400));
  CHECK(b.sink.state() == DeviceState::faulted);
  REQUIRE(b.sink.events.size() == 1);
  CHECK_THAT(b.sink.events[0], Catch::Contains("127.0.0.1:" + std::to_string(port) + ": connect"));
  CHECK_THAT(b.sink.events[0], Catch::Contains("is its bridge running? Start /") &&
                                   Catch::EndsWith("/timetagger.py"));
  Server server(b.loop, port);
  REQUIRE(server.accept());
  server.send(b.golden[0]);
  CHECK(b.until([&] { return b.sink.state() == DeviceState::streaming; }));
}

TEST_CASE("a server that does not use the bridge protocol is refused and reported once") {
  Bench b;
  b.start(make_tdc(b.loop, {b.server.address()}));
  const auto [bytes, text] = GENERATE_COPY(
      std::pair(
          Bytes{'S', 'S', 'H', '-', '2', '.', '0', '\r', '\n'},
          std::string("the received bytes are not a bridge block; expected an echofuse bridge")),
      std::pair(test::make_block(bridge::BlockKind::hello, 0, test::view_of("[1]")),
                std::string("the hello block is not valid: expected a JSON object with model, "
                            "serial and firmware")));
  for (std::uint64_t round = 1; round <= 2; ++round) {
    REQUIRE(b.server.accept());
    b.server.send(bytes);
    REQUIRE(b.until([&] { return b.sink.state() == DeviceState::faulted; }));
    CHECK(b.sink.events == std::vector<std::string>{text});
  }
  CHECK(b.sink.states == std::vector<DeviceState>{DeviceState::connecting, DeviceState::faulted});
}

TEST_CASE("a bridge driver can be destroyed at any time") {
  Bench b;
  for (int steps = 0; steps < 12; ++steps) {
    b.start(make_tdc(b.loop, {b.server.address()}));
    int left = steps;  // number of further checks of the condition before the loop stops
    b.loop.run_until([&] { return left-- == 0; }, b.loop.now() + std::chrono::milliseconds(steps));
    b.driver.reset();
    b.loop.run_for(std::chrono::milliseconds(5));
  }
}

TEST_CASE("the camera driver receives depth frames and axes from a bridge") {
  Bench b;
  b.connect(make_depth(b.loop, {b.server.address()}));
  b.server.send(b.golden[0]);
  b.loop.run_for(std::chrono::milliseconds(30));
  // The state is `connecting` until the first frame arrives.
  CHECK(b.sink.state() == DeviceState::connecting);
  const Bytes depth = b.golden[2];
  const Bytes next =
      test::make_block(bridge::BlockKind::depth, 3, ByteView(depth).subspan(bridge::header_bytes));
  b.server.send(test::join({depth, next}));
  REQUIRE(b.until([&] { return b.sink.depth.size() == 2; }));
  CHECK(b.sink.states == std::vector<DeviceState>{DeviceState::connecting, DeviceState::streaming});
  REQUIRE(b.sink.info.axes.size() == 2);
  CHECK(b.sink.info.axes[0].name == "depth_x");
  CHECK(b.sink.info.axes[1].step == -0.5);
  CHECK(b.sink.info.model == "Time Tagger Ultra");
  CHECK(b.sink.depth[0].depth_mm == std::vector<std::uint16_t>{0, 1000, 2000, 3000, 4000, 0});
  // The bridge dropped 5 frames, and block 1 is missing, so 6 frames are lost.
  CHECK(b.sink.depth[0].lost_before == 6);
  CHECK(b.count("frames") == 2);
  b.server.send(b.golden[1]);
  CHECK(b.until([&] { return b.count("bad_payloads") == 1; }));
}

TEST_CASE(
    "lost camera frames are counted by the frame index and by the bridge, even across a "
    "reconnection") {
  Bench b;
  b.connect(make_depth(b.loop, {b.server.address()}));
  // Frames 8 and 9 were lost before frame 10.
  b.server.send(test::join({b.golden[0], depth_block(1, 7), depth_block(2, 10)}));
  REQUIRE(b.until([&] { return b.sink.depth.size() == 2; }));
  b.server.client.reset();
  REQUIRE(b.server.accept());
  b.server.send(test::join({b.golden[0], depth_block(1, 40), depth_block(4, 43)}));
  REQUIRE(b.until([&] { return b.sink.depth.size() == 4; }));
  b.server.client.reset();
  REQUIRE(b.server.accept());
  // The restart of the frame index shows that at least one frame was lost. The header of each block
  // states the number of frames that the bridge dropped before it numbered them.
  b.server.send(test::join({b.golden[0], depth_block(1, 1), depth_block(2, 2, 5), depth_block(3, 3),
                            depth_block(4, 6, 1)}));
  REQUIRE(b.until([&] { return b.sink.depth.size() == 8; }));
  const std::uint32_t lost[] = {0, 2, 29, 2, 1, 5, 0, 2};
  for (std::size_t i = 0; i < 8; ++i) CHECK(b.sink.depth[i].lost_before == lost[i]);
  CHECK(b.count("lost_frames") == 41);
}

TEST_CASE("the counting-board driver receives histograms and their axis from a bridge") {
  Bench b;
  const ByteView counts = ByteView(b.sensors[1]).subspan(bridge::header_bytes);
  b.connect(make_tdc(b.loop, {b.server.address()}));
  b.server.send(b.sensors[0]);
  b.loop.run_for(std::chrono::milliseconds(30));
  // The state is `connecting` until the first histogram arrives.
  CHECK(b.sink.state() == DeviceState::connecting);

  SECTION("lost histograms are counted by block number") {
    b.server.send(
        test::join({b.sensors[1], test::make_block(bridge::BlockKind::histogram, 4, counts, 3)}));
    REQUIRE(b.until([&] { return b.sink.histograms.size() == 2; }));
    CHECK(b.sink.state() == DeviceState::streaming);
    CHECK(b.sink.info.serial == "B7");
    REQUIRE(b.sink.info.axes.size() == 1);
    CHECK(b.sink.info.axes[0].step == 92.5);
    CHECK(b.sink.histograms[0].lost_before == 0);
    // The bridge dropped 3 histograms, and blocks 2 and 3 are missing, so 5 histograms are lost.
    CHECK(b.sink.histograms[1].lost_before == 5);
    CHECK(b.count("histograms") == 2);
  }
  Bytes zones(counts.begin(), counts.end());
  zones[0] = 5, zones[4] = 1;  // 5 zones of 1 bin each
  SECTION("zones without directions in the hello block have unknown directions") {
    b.server.send(test::make_block(bridge::BlockKind::histogram, 1, zones));
    REQUIRE(b.until([&] { return b.sink.histograms.size() == 1; }));
    CHECK(b.sink.info.axes.at(0).zones == Zones(5));
    CHECK(b.sink.info.axes[0].count == 1);
    CHECK(b.sink.histograms[0].counts.size() == 5);
  }
  SECTION("zones are read from the hello block, and a different number of histograms is refused") {
    const std::string hello =
        R"({"sends": "histograms", "zones": [{"x": -0.1, "y": 0, "width": 0.2, "zero_ps": 7.5}]})";
    b.server.client.reset();
    REQUIRE(b.server.accept());
    b.sink.events.clear();  // removes the warning about the lost connection
    b.server.send(test::make_block(bridge::BlockKind::hello, 0, test::view_of(hello)));
    for (std::uint32_t i = 1; i < 3; ++i)
      b.server.send(test::make_block(bridge::BlockKind::histogram, i, zones));
    REQUIRE(b.until([&] { return b.count("bad_payloads") == 2; }));
    CHECK(b.sink.events ==
          std::vector<std::string>{"its histograms have 5 zones, but the hello block lists 1"});
    CHECK(b.sink.histograms.empty());
    b.server.send(test::make_block(bridge::BlockKind::histogram, 3, counts));
    REQUIRE(b.until([&] { return b.sink.histograms.size() == 1; }));
    CHECK(b.sink.info.axes.at(0).zones == Zones{{-0.1, 0, 0.2, 7.5}});
  }
}

TEST_CASE("the error for a hello block that lacks a histogram key contains the name of the key") {
  Bench b;
  b.connect(make_tdc(b.loop, {b.server.address()}));
  b.server.send(test::join({b.golden[0], b.sensors[1]}));
  REQUIRE(b.until([&] { return !b.sink.events.empty(); }));
  CHECK_THAT(b.sink.events[0], Catch::Contains("add \"sends\": \"histograms\""));
}

TEST_CASE("the radar driver receives range profiles from a bridge") {
  Bench b;
  Bytes later(b.sensors[2].begin() + bridge::header_bytes, b.sensors[2].end());
  later[4] = 45;  // changes the frame number to 45; the number of the first frame is 42
  RadarConfig config;
  config.address = b.server.address();
  b.connect(make_radar(b.loop, config));
  b.server.send(test::join(
      {b.sensors[0], b.sensors[2], test::make_block(bridge::BlockKind::range_profile, 3, later)}));
  REQUIRE(b.until([&] { return b.sink.radar.size() == 2; }));
  CHECK(b.sink.state() == DeviceState::streaming);
  CHECK(b.sink.info.sensor == Sensor::radar);
  CHECK(b.sink.info.axes.at(0).quantity == "power");
  CHECK(b.sink.radar[0].power == std::vector<float>{1, 0, 2.5F, 1e9F});
  CHECK(b.sink.radar[1].lost_before == 2);  // frames 43 and 44 were lost
}

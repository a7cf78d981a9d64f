// SPDX-License-Identifier: MIT
// Tests tagger and camera drivers in virtual time with bridges that stop sending, send wrong
// lengths, close the connection and accept a new one.
#include <deque>

#include "../catch.hpp"
#include "../fixtures/wire.hpp"
#include "blocks.hpp"
#include "drivers/bridge/bridge_driver.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "sink.hpp"

using test::counter;
using test::hello_block;
using test::run_until;

namespace {

constexpr auto limit = std::chrono::seconds(10);  // time limit for reconnecting

// A tagger driver or a camera driver, together with its bridge.
struct Pair {
  Pair(port::VirtualLoop& l, Sensor sensor) : loop(l), kind(sensor), listener(loop) {
    listener.start({.connected = [this] { ++clients, connected = true; },
                    .left = [this] { connected = false; }});
    listener.accept();
    if (kind == Sensor::spd)
      driver = std::make_unique<bridge::BridgeDriver>(Sensor::spd, loop, "test", listener.opener());
    else
      driver =
          std::make_unique<bridge::BridgeDriver>(Sensor::depth, loop, "test", listener.opener());
    driver->start(sink);
  }
  ~Pair() { driver->stop(); }

  bool await_client() {
    listener.accept();
    const int before = clients;
    return run_until(
        loop, [&] { return clients > before; }, limit);
  }
  void send(const Bytes& bytes) {
    sent.push_back(bytes);
    listener.write(sent.back(), [](bool) {});
  }
  Bytes block(std::uint32_t n) const {
    return kind == Sensor::spd ? test::tags_block(n) : test::depth_block(n, n);
  }
  std::vector<std::uint64_t> delivered() const {
    std::vector<std::uint64_t> numbers;
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
  bool has(std::size_t count) const { return delivered().size() == count; }

  port::VirtualLoop& loop;
  Sensor kind;
  test::KeepingSink sink;
  test::MemoryListener listener;
  std::deque<Bytes> sent;
  int clients = 0;
  bool connected = false;
  std::unique_ptr<Driver> driver;
};

using Numbers = std::vector<std::uint64_t>;

}  // namespace

TEST_CASE(
    "the driver reconnects if a bridge stalls, sends a wrong length or omits the hello block") {
  port::VirtualLoop loop;
  Pair pair(loop, GENERATE(Sensor::spd, Sensor::depth));
  const std::string what = GENERATE("silent", "slow", "wrong length", "no hello");
  CAPTURE(what);
  REQUIRE(run_until(loop, [&] { return pair.connected; }));
  if (what != "no hello") pair.send(hello_block());
  pair.send(pair.block(1));
  Bytes too_long = pair.block(2);
  too_long[14] = 0xff;  // sets the payload length to about 16 MiB
  if (what == "wrong length") pair.send(test::join({too_long, pair.block(3), pair.block(4)}));
  if (what != "no hello") REQUIRE(run_until(loop, [&] { return pair.has(1); }));
  const HostTime begin = loop.now();
  pair.listener.accept();
  const Bytes drip = pair.block(2);
  const auto back = [&] { return pair.clients == 2; };
  for (std::size_t at = 0; at < drip.size() && !run_until(loop, back, std::chrono::seconds(1));
       ++at)
    if (what == "slow") pair.send({drip[at]});
  // The driver gives up after four checks in a row without a block and reconnects 0.1 s later. The
  // checks are 1 s apart. After a hello block, the first check succeeds, so the driver gives up 1 s
  // later.
  CHECK(seconds(loop.now() - begin) == Approx(what == "no hello" ? 4.1 : 5.1));
  pair.send(test::join({hello_block(), pair.block(1), pair.block(2)}));
  const std::size_t before = what == "no hello" ? 0 : 1;
  REQUIRE(run_until(loop, [&] { return pair.has(before + 2); }));
  // If the hello block is missing, it also counts as lost, and so does the data block that follows
  // it.
  CHECK(pair.lost() == (what == "no hello" ? 3 : 1));
  CHECK(counter(*pair.driver, "connections") == 2);
  CHECK(pair.sink.events.size() == 1);
}

TEST_CASE("a damaged bridge block is reported in one line, and the driver closes and reconnects") {
  port::VirtualLoop loop;
  Pair pair(loop, GENERATE(Sensor::spd, Sensor::depth));
  REQUIRE(run_until(loop, [&] { return pair.connected; }));
  Bytes damaged = pair.block(2);
  damaged.back() ^= 1;
  pair.send(test::join({hello_block(), pair.block(1), damaged, pair.block(3)}));
  REQUIRE(run_until(loop, [&] { return !pair.connected; }));
  CHECK(pair.delivered() == Numbers{1});
  CHECK(pair.sink.events == std::vector<std::string>{"the block has a wrong checksum"});
  CHECK(pair.sink.state() == DeviceState::faulted);
  REQUIRE(pair.await_client());
  pair.send(test::join({hello_block(), pair.block(4), pair.block(5)}));
  REQUIRE(run_until(loop, [&] { return pair.has(3); }));
  CHECK(pair.delivered() == Numbers{1, 4, 5});
  CHECK(pair.lost() > 0);
  CHECK(pair.sink.state() == DeviceState::streaming);
  CHECK(pair.sink.events.size() == 1);
  CHECK(counter(*pair.driver, "bad_crcs") == 1);
  CHECK(counter(*pair.driver, "junk_bytes") == damaged.size());
  CHECK(counter(*pair.driver, "connections") == 2);
}

TEST_CASE("the bridge driver reconnects after each of 100 disconnections") {
  port::VirtualLoop loop;
  Pair pair(loop, GENERATE(Sensor::spd, Sensor::depth));
  REQUIRE(run_until(loop, [&] { return pair.connected; }));
  HostTime longest{};
  for (std::size_t round = 1; round <= 100; ++round) {
    pair.send(test::join({hello_block(), pair.block(1), {'E', 'F', 'B'}}));
    REQUIRE(run_until(loop, [&] { return pair.has(round); }));
    pair.listener.hang_up();
    const HostTime begin = loop.now();
    REQUIRE(pair.await_client());
    longest = std::max(longest, loop.now() - begin);
  }
  CHECK(longest == std::chrono::seconds(2));  // longest delay between connection attempts
  // One block was lost before each of the last 99 connections that delivered data.
  CHECK(pair.lost() == 99);
  CHECK(pair.clients == 101);
  CHECK(counter(*pair.driver, "junk_bytes") == 300);  // the beginning of a block in each connection
  CHECK(counter(*pair.driver, "connections") == 101);
}

TEST_CASE("tags dropped by a bridge are reported with the next block and counted") {
  port::VirtualLoop loop;
  Pair pair(loop, Sensor::spd);
  REQUIRE(run_until(loop, [&] { return pair.connected; }));
  Bytes tag;
  put(tag, Tag{.channel = 1, .time_ps = 1});
  pair.send(test::join({hello_block(), test::make_block(bridge::BlockKind::tags, 1, tag, 7)}));
  REQUIRE(run_until(loop, [&] { return pair.has(1); }));
  CHECK(pair.sink.blocks.at(0).lost_items == 7);
  CHECK(counter(*pair.driver, "lost_items") == 7);
}

// SPDX-License-Identifier: MIT
// The two bridge drivers when a bridge falls silent, lies, closes and comes back: over TCP, in real
// time.
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/write.hpp>
#include <catch2/catch.hpp>
#include <optional>
#include <vector>

#include "blocks.hpp"
#include "drivers/make_driver.hpp"
#include "sink.hpp"

using namespace echofuse;
using boost::asio::ip::tcp;
using test::counter;
using test::hello_block;
using test::run_for;
using test::run_until;

namespace {

constexpr auto limit = std::chrono::seconds(10);  // for a reconnection

// A driver of either kind and a bridge for it.
struct Pair {
  Pair(boost::asio::io_context& context, Sensor sensor)
      : io(context), kind(sensor), acceptor(io, {boost::asio::ip::address_v4::loopback(), 0}) {
    const std::string address =
        "bridge:tcp://127.0.0.1:" + std::to_string(acceptor.local_endpoint().port());
    driver =
        kind == Sensor::spd ? make_tdc(io, {address}, clock) : make_depth(io, {address}, clock);
    await_client();
    driver->start(sink);
  }
  ~Pair() { driver->stop(); }

  void await_client() {
    client.reset();
    acceptor.async_accept([this](const boost::system::error_code& error, tcp::socket socket) {
      if (error) return;
      client.emplace(std::move(socket));
      ++clients;
    });
  }
  void send(const Bytes& bytes) { boost::asio::write(*client, boost::asio::buffer(bytes)); }
  Bytes block(std::uint32_t n) const {
    return kind == Sensor::spd ? test::tags_block(n) : test::depth_block(n);
  }
  std::vector<std::uint64_t> delivered() const {
    std::vector<std::uint64_t> numbers;
    for (const Tag& tag : sink.tags) numbers.push_back(static_cast<std::uint64_t>(tag.time_ps));
    for (const DepthFrame& frame : sink.depth) numbers.push_back(frame.frame_index);
    return numbers;
  }
  std::uint64_t lost() const {
    std::uint64_t sum = 0;
    for (const TagBlock& b : sink.blocks) sum += b.lost_blocks + b.lost_items;
    for (const DepthFrame& frame : sink.depth) sum += frame.lost_before;
    return sum;
  }
  bool has(std::size_t count) const { return delivered().size() == count; }

  boost::asio::io_context& io;
  Sensor kind;
  SystemClock clock;
  test::KeepingSink sink;
  tcp::acceptor acceptor;
  std::optional<tcp::socket> client;
  int clients = 0;
  std::unique_ptr<Driver> driver;
};

using Numbers = std::vector<std::uint64_t>;

}  // namespace

TEST_CASE("silence, a byte now and then, a lying length and a missing hello, side by side") {
  boost::asio::io_context io;
  const Sensor kind = GENERATE(Sensor::spd, Sensor::depth);
  Pair silent(io, kind), slow(io, kind), lying(io, kind), rude(io, kind);
  const auto all = {&silent, &slow, &lying, &rude};
  REQUIRE(run_until(io, [&] {
    return std::all_of(all.begin(), all.end(), [](auto* p) { return p->client.has_value(); });
  }));
  for (Pair* pair : {&silent, &slow, &lying}) pair->send(hello_block());
  for (Pair* pair : all) pair->send(pair->block(1));
  Bytes liar = lying.block(2);
  liar[14] = 0xff;  // 16 MiB
  lying.send(test::join({liar, lying.block(3), lying.block(4)}));
  REQUIRE(run_until(io, [&] { return silent.has(1) && slow.has(1) && lying.has(1); }));
  std::vector<tcp::socket> open;  // the drivers have to find out by themselves
  for (Pair* pair : all) {
    open.push_back(std::move(*pair->client));
    pair->await_client();
  }
  const auto back = [&] { return silent.client && slow.client && lying.client && rude.client; };
  const auto begin = std::chrono::steady_clock::now();
  const Bytes drip = slow.block(2);
  for (std::size_t at = 0; at < drip.size() && !run_until(io, back, std::chrono::seconds(1));
       ++at) {
    boost::system::error_code ignored;
    open[1].send(boost::asio::buffer(&drip[at], 1), 0, ignored);
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  CAPTURE(took.count());
  CHECK(took < limit);
  for (Pair* pair : all) {
    pair->send(test::join({hello_block(), pair->block(1), pair->block(2)}));
    const std::size_t before = pair == &rude ? 0 : 1;
    REQUIRE(run_until(io, [&] { return pair->has(before + 2); }));
    CHECK(pair->lost() == (pair == &rude ? 3 : 1));  // rude: its hello and the block without it
    CHECK(counter(*pair->driver, "connections") == 2);
    CHECK(pair->sink.events.size() == 1);
  }
}

TEST_CASE("a bridge that closes in the middle of a block costs that block") {
  boost::asio::io_context io;
  Pair pair(io, GENERATE(Sensor::spd, Sensor::depth));
  REQUIRE(run_until(io, [&] { return pair.client.has_value(); }));
  Bytes half = pair.block(2);
  half.resize(half.size() / 2);
  pair.send(test::join({hello_block(), pair.block(1), half}));
  REQUIRE(run_until(io, [&] { return pair.has(1); }));
  pair.await_client();
  REQUIRE(run_until(
      io, [&] { return pair.client.has_value(); }, limit));
  pair.send(test::join({hello_block(), pair.block(1), pair.block(2)}));
  REQUIRE(run_until(io, [&] { return pair.has(3); }));
  CHECK(pair.delivered() == Numbers{1, 1, 2});
  CHECK(pair.lost() == 1);
  CHECK(counter(*pair.driver, "junk_bytes") == half.size());
}

TEST_CASE("a damaged block is told in one line, and ends the connection, the next one goes on") {
  boost::asio::io_context io;
  Pair pair(io, GENERATE(Sensor::spd, Sensor::depth));
  REQUIRE(run_until(io, [&] { return pair.client.has_value(); }));
  Bytes damaged = pair.block(2);
  damaged.back() ^= 1;
  pair.send(test::join({hello_block(), pair.block(1), damaged, pair.block(3)}));
  bool closed = false;
  Bytes nothing(1);
  pair.client->async_read_some(
      boost::asio::buffer(nothing),
      [&](const boost::system::error_code& error, std::size_t) { closed = error.failed(); });
  REQUIRE(run_until(io, [&] { return closed; }));
  CHECK(pair.delivered() == Numbers{1});
  CHECK(pair.sink.events == std::vector<std::string>{"it sent a block whose checksum is wrong"});
  CHECK(pair.sink.state() == DeviceState::faulted);
  pair.await_client();
  REQUIRE(run_until(
      io, [&] { return pair.client.has_value(); }, limit));
  pair.send(test::join({hello_block(), pair.block(4), pair.block(5)}));
  REQUIRE(run_until(io, [&] { return pair.has(3); }));
  CHECK(pair.delivered() == Numbers{1, 4, 5});
  CHECK(pair.lost() > 0);
  CHECK(pair.sink.state() == DeviceState::streaming);
  CHECK(pair.sink.events.size() == 1);
  CHECK(counter(*pair.driver, "bad_crcs") == 1);
  CHECK(counter(*pair.driver, "junk_bytes") == damaged.size());
  CHECK(counter(*pair.driver, "connections") == 2);
}

TEST_CASE("unplugged and plugged in a hundred times") {
  boost::asio::io_context io;
  Pair tdc(io, Sensor::spd), camera(io, Sensor::depth);
  std::chrono::steady_clock::duration longest{};
  for (std::size_t round = 1; round <= 100; ++round) {
    const auto begin = std::chrono::steady_clock::now();
    REQUIRE(run_until(
        io, [&] { return tdc.client && camera.client; }, limit));
    for (Pair* pair : {&tdc, &camera})
      pair->send(test::join({hello_block(), pair->block(1), {'E', 'F', 'B'}}));
    REQUIRE(run_until(io, [&] { return tdc.has(round) && camera.has(round); }));
    longest = std::max(longest, std::chrono::steady_clock::now() - begin);
    for (Pair* pair : {&tdc, &camera}) pair->await_client();
  }
  CAPTURE(std::chrono::duration<double>(longest).count());
  CHECK(longest < limit);
  for (Pair* pair : {&tdc, &camera}) {
    CHECK(pair->lost() == 99);  // one at least for every connection but the first
    CHECK(pair->clients == 100);
    CHECK(counter(*pair->driver, "connections") == 100);
  }
}

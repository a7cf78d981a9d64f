// SPDX-License-Identifier: MIT
#include "recon/live/session.hpp"

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <stdexcept>

#include "../catch.hpp"

using namespace echofuse::view;

namespace {

namespace net = boost::asio;
using net::ip::tcp;
using namespace std::chrono_literals;

constexpr std::string_view handshake =
    "GET /live HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";

// Returns a WebSocket text frame as sent by a client, with a mask of zero.
std::string frame(std::string_view text) {
  REQUIRE(text.size() < 126);
  return std::string("\x81") + static_cast<char>(0x80 | text.size()) + std::string(4, '\0') +
         std::string(text);
}

// Owns the sessions under test and connects raw clients to them. The sessions and the clients run
// on the same thread.
struct Owner final : SessionOwner {
  const Access& access() const override { return access_; }
  bool has_run(const std::string&) override { return true; }
  std::string runs() override { throw std::out_of_range("runs"); }
  void opened(const std::shared_ptr<Session>& session) override {
    ++openings;
    if (greeting) session->send(MessageKind::sheet, greeting);
  }
  void closed(const std::shared_ptr<Session>&) override { ++closings; }
  Message answer_to(Session&, const Request& request) override {
    if (!std::holds_alternative<Mark>(request)) throw std::length_error("no mark");
    ++marks;
    return std::make_shared<Bytes>(1);
  }

  tcp::socket connect(std::string_view bytes) {
    tcp::acceptor acceptor(io, {net::ip::address_v4::loopback(), 0});
    tcp::socket client(io);
    client.connect(acceptor.local_endpoint());
    std::make_shared<Session>(acceptor.accept(), *this, open)->start();
    write(client, bytes);
    return client;
  }
  static void write(tcp::socket& client, std::string_view bytes) {
    net::write(client, net::buffer(bytes.data(), bytes.size()));
  }
  // Waits for up to five seconds. The timeout of ten seconds for clients that do not answer pings
  // is longer.
  template <class Condition>
  bool waits_for(Condition happened) {
    const auto end = std::chrono::steady_clock::now() + 5s;
    while (!happened() && std::chrono::steady_clock::now() < end) io.run_for(10ms);
    return happened();
  }

  int open = 0, openings = 0, closings = 0, marks = 0;
  net::io_context io;
  net::executor_work_guard<net::io_context::executor_type> work = net::make_work_guard(io);
  Access access_;
  Message greeting;
};

}  // namespace

TEST_CASE("an exception in a request handler ends only the session of that request") {
  Owner owner;
  tcp::socket healthy = owner.connect(handshake);
  REQUIRE(owner.waits_for([&] { return owner.openings == 1; }));
  // Only a viewer of a folder has a list of runs. In this test, requesting the list throws an
  // exception.
  owner.access_.many = true;
  const tcp::socket runs = owner.connect("GET /runs HTTP/1.1\r\nHost: localhost\r\n\r\n");
  CHECK(owner.waits_for([&] { return owner.open == 1; }));
  owner.access_.many = false;
  tcp::socket asking = owner.connect(handshake);
  CHECK(owner.waits_for([&] { return owner.openings == 2; }));
  Owner::write(asking, frame(R"({"show": 1})"));
  CHECK(owner.waits_for([&] { return owner.open == 1; }));
  CHECK(owner.closings == 2);
  Owner::write(healthy, frame(R"({"mark": "x"})"));
  CHECK(owner.waits_for([&] { return owner.marks == 1; }));
}

TEST_CASE("a session queues eight mark requests if answers are not read, and ends at the ninth") {
  Owner owner;
  // The greeting is larger than the socket buffers, so the answers to mark requests must wait.
  owner.greeting = std::make_shared<Bytes>(64 << 20);
  tcp::socket client = owner.connect(handshake);
  REQUIRE(owner.waits_for([&] { return owner.openings == 1; }));
  for (int i = 0; i < 8; ++i) Owner::write(client, frame(R"({"mark": "x"})"));
  owner.io.run_for(200ms);
  CHECK((owner.marks == 0 && owner.closings == 0));
  SECTION("eight queued mark requests are answered when the client reads again") {
    std::string all(1 << 20, '\0');
    client.non_blocking(true);
    CHECK(owner.waits_for([&] {
      boost::system::error_code nothing_yet;
      while (client.read_some(net::buffer(all), nothing_yet) > 0) {
      }
      return owner.marks == 8;
    }));
    CHECK(owner.closings == 0);
  }
  SECTION("a ninth queued mark request ends the session") {
    Owner::write(client, frame(R"({"mark": "x"})"));
    CHECK(owner.waits_for([&] { return owner.closings == 1; }));
    CHECK(owner.marks == 0);
  }
}

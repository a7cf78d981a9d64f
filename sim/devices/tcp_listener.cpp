// SPDX-License-Identifier: MIT
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/write.hpp>
#include <utility>

#include "sim/devices/listener.hpp"

namespace echofuse::sim {
namespace {

using boost::asio::ip::tcp;
using ErrorCode = boost::system::error_code;

class TcpListener final : public Listener {
 public:
  TcpListener(port::SystemLoop& loop, std::uint16_t port)
      : acceptor_(loop.io(), {boost::asio::ip::address_v4::loopback(), port}),
        endpoint_(acceptor_.local_endpoint()),
        socket_(loop.io()) {}

  void start(Handlers handlers) override { handlers_ = std::move(handlers); }

  void accept() override {
    accept_next_ = true;
    if (accepting_ || !acceptor_.is_open()) return;
    accepting_ = true;
    acceptor_.async_accept([this](const ErrorCode& error, tcp::socket socket) {
      accepting_ = false;
      if (error) {
        if (accept_next_) accept();
        return;
      }
      accept_next_ = false;
      socket_ = std::move(socket);
      ErrorCode ignored;
      socket_.set_option(tcp::no_delay(true), ignored);
      handlers_.connected();
      watch();
    });
  }

  void plug(bool in) override {
    if (!in) {
      acceptor_.close();
      return;
    }
    acceptor_.open(endpoint_.protocol());
    acceptor_.set_option(tcp::acceptor::reuse_address(true));
    acceptor_.bind(endpoint_);
    acceptor_.listen();
    if (accept_next_) accept();
  }
  bool plugged() const override { return acceptor_.is_open(); }

  void write(ByteView bytes, std::function<void(bool)> done) override {
    boost::asio::async_write(
        socket_, boost::asio::buffer(bytes.data(), bytes.size()),
        [done = std::move(done)](const ErrorCode& error, std::size_t) { done(!error); });
  }

  void hang_up() override {
    ErrorCode ignored;
    socket_.close(ignored);
  }

  std::string address() const override {
    return "bridge:tcp://127.0.0.1:" + std::to_string(endpoint_.port());
  }

 private:
  // Detects a disconnect. Clients of this protocol send nothing, so a read ends only when the
  // client disconnects.
  void watch() {
    socket_.async_read_some(boost::asio::buffer(unread_), [this](const ErrorCode& error, auto) {
      if (error == boost::asio::error::operation_aborted) return;
      if (error)
        handlers_.left();
      else
        watch();
    });
  }

  tcp::acceptor acceptor_;
  tcp::endpoint endpoint_;
  tcp::socket socket_;
  Handlers handlers_;
  std::array<std::uint8_t, 256> unread_{};
  // wanted_: accept() was called; accepting_: async_accept() is pending
  bool accept_next_ = false, accepting_ = false;
};

}  // namespace

std::unique_ptr<Listener> make_tcp_listener(port::SystemLoop& loop, std::uint16_t port) {
  return std::make_unique<TcpListener>(loop, port);
}

}  // namespace echofuse::sim

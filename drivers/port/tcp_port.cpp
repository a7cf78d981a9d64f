// SPDX-License-Identifier: MIT
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>

#include "drivers/port/open_port.hpp"
#include "drivers/port/stream_port.hpp"

namespace echofuse::port {
namespace {

using boost::asio::ip::tcp;
using boost::system::error_code;

class TcpPort final : public StreamPort<tcp::socket> {
 public:
  TcpPort(boost::asio::io_context& io, const std::string& host, std::uint16_t port)
      : StreamPort(io, host + ":" + std::to_string(port), 256u << 10),
        resolver_(std::make_shared<tcp::resolver>(io)),
        host_(host),
        port_(port) {}

  void open(PortHandlers handlers) override {
    link_->handlers = std::move(handlers);
    resolver_->async_resolve(
        host_, std::to_string(port_),
        [link = link_, resolver = resolver_](const error_code& error,
                                             const tcp::resolver::results_type& addresses) {
          if (link->closed) return;
          if (error) return link->fail(error, "resolve");
          connect(link, addresses);
        });
  }

 private:
  static void connect(const LinkPtr& link, const tcp::resolver::results_type& addresses) {
    boost::asio::async_connect(link->stream, addresses,
                               [link](const error_code& error, const tcp::endpoint&) {
                                 if (error) return link->fail(error, "connect");
                                 error_code ignored;
                                 link->stream.set_option(tcp::no_delay(true), ignored);
                                 begin(link);
                               });
  }

  std::shared_ptr<tcp::resolver> resolver_;
  std::string host_;
  std::uint16_t port_;
};

}  // namespace

std::unique_ptr<BytePort> make_tcp_port(boost::asio::io_context& io, const std::string& host,
                                        std::uint16_t port) {
  return std::make_unique<TcpPort>(io, host, port);
}

}  // namespace echofuse::port

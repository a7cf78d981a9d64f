// SPDX-License-Identifier: MIT
#include "drivers/port/serial_port.hpp"

#include <termios.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/serial_port.hpp>

#include "drivers/port/stream_port.hpp"

namespace echofuse::port {
namespace {

using boost::asio::serial_port;
using boost::system::error_code;

error_code set_up(serial_port& line, const std::string& path, std::uint32_t baud) {
  error_code error;
  const auto set = [&](const auto& option) {
    if (!error) line.set_option(option, error);
  };
  line.open(path, error);
  set(serial_port::baud_rate(baud));
  set(serial_port::character_size(8));
  set(serial_port::parity(serial_port::parity::none));
  set(serial_port::stop_bits(serial_port::stop_bits::one));
  set(serial_port::flow_control(serial_port::flow_control::none));
  if (!error && ::tcflush(line.native_handle(), TCIOFLUSH) != 0)
    error.assign(errno, boost::system::system_category());
  return error;
}

class SerialPort final : public StreamPort<serial_port> {
 public:
  SerialPort(boost::asio::io_context& io, const std::string& path, std::uint32_t baud)
      : StreamPort(io, path, 16u << 10), path_(path), baud_(baud) {}

  void open(PortHandlers handlers) override {
    link_->handlers = std::move(handlers);
    const error_code error = set_up(link_->stream, path_, baud_);
    // Only the baud rate can be one that the system does not know.
    const bool unknown_rate = error == boost::asio::error::invalid_argument;
    const std::string doing = unknown_rate ? "baud rate " + std::to_string(baud_) +
                                                 " (115200, 921600 or another usual one)"
                                           : "open";
    boost::asio::post(link_->stream.get_executor(), [link = link_, error, doing] {
      if (error) return link->fail(error, doing.c_str());
      begin(link);
    });
  }

 private:
  std::string path_;
  std::uint32_t baud_;
};

}  // namespace

std::unique_ptr<BytePort> make_serial_port(boost::asio::io_context& io, const std::string& path,
                                           std::uint32_t baud) {
  return std::make_unique<SerialPort>(io, path, baud);
}

}  // namespace echofuse::port

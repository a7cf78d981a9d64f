// SPDX-License-Identifier: MIT
#include <fcntl.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <termios.h>
#include <unistd.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/serial_port.hpp>

#include "drivers/port/open_port.hpp"
#include "drivers/port/stream_port.hpp"
#include "drivers/util/program.hpp"

namespace echofuse::port {
namespace {

using boost::asio::serial_port;
using boost::system::error_code;

error_code last_error() { return {errno, boost::system::system_category()}; }

// Locks the port and sets raw mode. Unlike TIOCEXCL, flock() also excludes root. If another program
// holds the lock, its settings and buffers remain unchanged. TIOCEXCL is skipped for a
// pseudo-terminal, because its master would keep the flag after the port is closed.
error_code make_ours(int fd) {
  struct stat is {};
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0) {
    if (errno == EWOULDBLOCK) errno = EBUSY;
    return last_error();
  }
  if (::fstat(fd, &is) != 0) return last_error();
  // major numbers of pseudoterminals (Linux, admin-guide/devices.txt)
  constexpr unsigned first_pty = 136, last_pty = 143;
  const unsigned kind = major(is.st_rdev);
  if ((kind < first_pty || kind > last_pty) && ::ioctl(fd, TIOCEXCL) != 0) return last_error();
  termios line{};
  if (::tcgetattr(fd, &line) != 0) return last_error();
  ::cfmakeraw(&line);
  line.c_cflag |= CREAD | CLOCAL;
  return ::tcsetattr(fd, TCSANOW, &line) == 0 ? error_code{} : last_error();
}

error_code open_line(serial_port& line, const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDWR | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
  if (fd < 0) return last_error();
  error_code error = make_ours(fd);
  if (!error) line.assign(fd, error);
  if (error) ::close(fd);
  return error;
}

error_code set_up(serial_port& line, const std::string& path, std::uint32_t baud) {
  error_code error = open_line(line, path);
  const auto set = [&](const auto& option) {
    if (!error) line.set_option(option, error);
  };
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
    // Only the baud rate can be unsupported; the other settings are always accepted.
    const bool unknown_rate = error == boost::asio::error::invalid_argument;
    const bool taken = error == boost::system::errc::device_or_resource_busy;
    const bool denied = error == boost::system::errc::permission_denied;
    const std::string doing =
        unknown_rate ? "baud rate " + std::to_string(baud_) +
                           " is not supported (expected a standard rate such as 115200 or 921600)"
        : taken  ? "cannot open (in use by another program)"
        : denied ? "cannot open (" + permission_hint(path_) + ")"
                 : "cannot open";
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

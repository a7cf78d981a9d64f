// SPDX-License-Identifier: MIT
#include "sim/devices/pty_uart.hpp"

#include <fcntl.h>
#include <pty.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "drivers/util/exit_code.hpp"

namespace echofuse::sim {
namespace {

// Time between successive deliveries of bytes to the host. The latency timers of USB serial
// adapters are 1 to 16 ms.
constexpr auto chunk_time = std::chrono::milliseconds(4);

[[noreturn]] void fail(const std::string& what) {
  throw Error(ExitCode::failed, what + ": " + std::strerror(errno));
}

int open_pty(int& slave, std::string& name) {
  int master = -1;
  std::array<char, 128> path{};
  if (::openpty(&master, &slave, path.data(), nullptr, nullptr) != 0)
    fail("cannot open a pseudo-terminal");
  name = path.data();
  termios settings{};
  ::tcgetattr(slave, &settings);
  ::cfmakeraw(&settings);
  ::tcsetattr(slave, TCSANOW, &settings);
  for (const int fd : {master, slave}) ::fcntl(fd, F_SETFD, FD_CLOEXEC);
  return master;
}

void publish(const std::string& target, const std::string& link) {
  const std::string fresh = link + ".new";
  ::unlink(fresh.c_str());
  if (::symlink(target.c_str(), fresh.c_str()) != 0 || ::rename(fresh.c_str(), link.c_str()) != 0)
    fail("cannot create the link " + link);
}

// Returns the termios constant of a baud rate; B0 if pseudo-terminals do not support the rate.
speed_t speed_of(unsigned baud) {
  switch (baud) {
    case 115200:
      return B115200;
    case 460800:
      return B460800;
    case 921600:
      return B921600;
    case 1000000:
      return B1000000;
    case 3000000:
      return B3000000;
    default:
      return B0;
  }
}

}  // namespace

PtyUart::PtyUart(port::SystemLoop& loop, std::string link, unsigned baud, Receive receive)
    : Uart(loop, baud, chunk_time),
      link_(std::move(link)),
      receive_(std::move(receive)),
      master_(loop.io()) {
  open();
}

void PtyUart::open() {
  std::string name;
  master_.assign(open_pty(slave_, name));
  master_.non_blocking(true);
  publish(name, link_);
  read();
}

PtyUart::~PtyUart() { close(); }

void PtyUart::close() {
  Uart::close();
  plug(false);
}

void PtyUart::plug(bool in) {
  if (in == (slave_ >= 0)) return;
  if (in) return open();
  ::unlink(link_.c_str());
  boost::system::error_code ignored;
  master_.close(ignored);
  ::close(slave_);
  slave_ = -1;
}

void PtyUart::read() {
  master_.async_read_some(boost::asio::buffer(in_),
                          [this](const boost::system::error_code& error, std::size_t n) {
                            if (error) return;
                            receive_({in_.data(), n});
                            read();
                          });
}

bool PtyUart::host_listens_at_our_rate() const {
  termios settings{};
  if (::tcgetattr(slave_, &settings) != 0) return false;
  return ::cfgetispeed(&settings) == speed_of(baud());
}

std::size_t PtyUart::deliver(Bytes chunk) {
  if (slave_ < 0) return 0;
  if (!host_listens_at_our_rate())
    for (auto& byte : chunk) byte = static_cast<std::uint8_t>(noise_());
  boost::system::error_code error;
  const std::size_t n = master_.write_some(boost::asio::buffer(chunk), error);
  return error ? 0 : n;
}

std::unique_ptr<Device> make_radar_ptys(port::SystemLoop& loop, ScenePlayer& player,
                                        const RadarOptions& options) {
  // ports of the radar board, which owns the UARTs
  auto ports = std::make_shared<std::vector<PtyUart*>>();
  const auto pty = [&](const std::string& link) {
    return [&loop, ports, link](unsigned baud, Uart::Receive receive) {
      auto uart = std::make_unique<PtyUart>(loop, link, baud, std::move(receive));
      ports->push_back(uart.get());
      return uart;
    };
  };
  const auto plug = [ports](bool in) {
    for (PtyUart* port : *ports) port->plug(in);
  };
  return make_radar_board(loop, player,
                          {options.seed, options.plan, options.sdk, options.board, plug},
                          pty(options.cli_link), pty(options.data_link));
}

}  // namespace echofuse::sim

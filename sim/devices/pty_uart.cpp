// SPDX-License-Identifier: MIT
#include "sim/devices/pty_uart.hpp"

#include <fcntl.h>
#include <pty.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "drivers/core/exit_code.hpp"

namespace echofuse::sim {
namespace {

// A USB bridge hands over what came in within its latency timer, 1 to 16 ms.
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
    fail("cannot make the link " + link);
}

// The termios constant of a rate, or B0 for a rate that a pty cannot be set to.
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

PtyUart::PtyUart(boost::asio::io_context& io, std::string link, unsigned baud, Receive receive)
    : link_(std::move(link)), baud_(baud), receive_(std::move(receive)), master_(io), timer_(io) {
  std::string name;
  master_.assign(open_pty(slave_, name));
  master_.non_blocking(true);
  publish(name, link_);
  read();
}

PtyUart::~PtyUart() { close(); }

void PtyUart::close() {
  if (slave_ < 0) return;
  ::unlink(link_.c_str());
  timer_.cancel();
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

void PtyUart::send(ByteView bytes) {
  if (slave_ < 0) return;
  queue_.insert(queue_.end(), bytes.begin(), bytes.end());
  if (pacing_ || queue_.empty()) return;
  pacing_ = true;
  due_ = std::chrono::steady_clock::now();
  pace();
}

void PtyUart::pace() {
  if (queue_.empty()) {
    pacing_ = false;
    return;
  }
  // 8N1: ten bit times a byte. Deadlines are absolute, so that a late timer costs no throughput.
  const double bytes_per_s = baud_ / 10.0;
  const auto fits = static_cast<std::size_t>(
      std::max(1.0, bytes_per_s * std::chrono::duration<double>(chunk_time).count()));
  const std::size_t n = std::min(fits, queue_.size());
  due_ += std::chrono::duration_cast<std::chrono::steady_clock::duration>(
      std::chrono::duration<double>(static_cast<double>(n) / bytes_per_s));
  timer_.expires_at(due_);
  timer_.async_wait([this, n](const boost::system::error_code& error) {
    if (error) return;
    const auto end = queue_.begin() + static_cast<std::ptrdiff_t>(n);
    Bytes chunk(queue_.begin(), end);
    queue_.erase(queue_.begin(), end);
    write(std::move(chunk));
    pace();
  });
}

bool PtyUart::host_listens_at_our_rate() const {
  termios settings{};
  if (::tcgetattr(slave_, &settings) != 0) return false;
  return ::cfgetispeed(&settings) == speed_of(baud_);
}

void PtyUart::write(Bytes chunk) {
  if (!host_listens_at_our_rate())
    for (auto& byte : chunk) byte = static_cast<std::uint8_t>(noise_());
  boost::system::error_code error;
  const std::size_t n = master_.write_some(boost::asio::buffer(chunk), error);
  sent_ += error ? 0 : n;
  lost_ += chunk.size() - (error ? 0 : n);
}

}  // namespace echofuse::sim

// SPDX-License-Identifier: MIT
#include "sim/devices/pty_uart.hpp"

#include <fcntl.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include "drivers/port/loop.hpp"
#include "lab_thread.hpp"

using namespace echofuse::test;

namespace {

constexpr unsigned baud = 921600;

int open_raw(const std::string& path, speed_t speed) {
  const int fd = ::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  REQUIRE(fd >= 0);
  termios settings{};
  ::tcgetattr(fd, &settings);
  ::cfmakeraw(&settings);
  ::cfsetspeed(&settings, speed);
  ::tcsetattr(fd, TCSANOW, &settings);
  return fd;
}

}  // namespace

TEST_CASE("a simulated UART sends at its baud rate and drops bytes that are not read") {
  const Folder dir;
  port::SystemLoop loop;
  const std::string link = dir / "port";
  sim::PtyUart uart(loop, link, baud, [](ByteView) {});
  const int host = open_raw(link, B921600);
  Bytes all(40'000);
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<std::uint8_t>(i * 31 + i / 256);
  Bytes heard;
  const bool listens = GENERATE(true, false);
  CAPTURE(listens);
  const auto start = std::chrono::steady_clock::now();
  // The host reads after each block. The buffer of a pty holds a whole block, so no byte is lost.
  const std::size_t block = listens ? 4000 : all.size();
  for (std::size_t end = block; end <= all.size(); end += block) {
    uart.send(ByteView(all).subspan(end - block, block));
    while (!uart.idle()) loop.run_for(std::chrono::milliseconds(1));
    while (listens && heard.size() + uart.lost() < end) {
      pollfd ready{host, POLLIN, 0};
      REQUIRE(::poll(&ready, 1, 10'000) == 1);
      std::uint8_t chunk[4096];
      const ssize_t n = ::read(host, chunk, sizeof chunk);
      REQUIRE(n > 0);
      heard.insert(heard.end(), chunk, chunk + n);
    }
  }
  const double took_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  CHECK(took_s >= 40'000 * 10.0 / baud);
  CHECK(uart.sent() + uart.lost() == all.size());
  if (listens) {
    CHECK(heard == all);
    CHECK(uart.lost() == 0);
  } else {
    CHECK(uart.lost() > 10'000);
  }
  ::close(host);
  uart.close();
  CHECK_FALSE(std::filesystem::is_symlink(link));
}

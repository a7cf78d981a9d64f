// SPDX-License-Identifier: MIT
// For LD_PRELOAD: a program's UTC is by so many seconds later as the file CLOCK_FILE says at the
// time.
#include <fcntl.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <array>
#include <cstdlib>

extern "C" int clock_gettime(clockid_t clock, timespec* time) noexcept {
  const auto code = static_cast<int>(::syscall(SYS_clock_gettime, clock, time));
  if (code != 0 || clock != CLOCK_REALTIME) return code;
  const char* path = std::getenv("CLOCK_FILE");
  const int fd = path ? ::open(path, O_RDONLY | O_CLOEXEC) : -1;
  if (fd < 0) return code;
  std::array<char, 32> text{};
  if (::read(fd, text.data(), text.size() - 1) > 0)
    time->tv_sec += std::strtol(text.data(), nullptr, 10);
  ::close(fd);
  return code;
}

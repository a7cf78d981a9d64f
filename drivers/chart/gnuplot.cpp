// SPDX-License-Identifier: MIT
#include "drivers/chart/gnuplot.hpp"

#include <unistd.h>

#include <array>
#include <csignal>

#include "drivers/core/atomic_write.hpp"
#include "drivers/core/exit_code.hpp"
#include "drivers/core/program.hpp"

namespace echofuse {
namespace {

void write_all(int file, const std::string& text) {
  std::size_t done = 0;
  while (done < text.size()) {
    const ssize_t n = ::write(file, text.data() + done, text.size() - done);
    if (n <= 0) return;  // it is gone: its exit code tells
    done += static_cast<std::size_t>(n);
  }
}

}  // namespace

void run_gnuplot(const std::string& script, const std::string& folder, const std::string& without) {
  std::array<int, 2> ends{};
  if (::pipe(ends.data()) != 0) throw Error(ExitCode::failed, without + "no pipe to gnuplot");
  const auto before = std::signal(SIGPIPE, SIG_IGN);
  const auto program = start_program({"gnuplot"}, {.folder = folder, .input = ends[0]});
  ::close(ends[0]);
  write_all(ends[1], script);
  ::close(ends[1]);
  const bool drawn = program && wait_for_program(*program) == 0;
  std::signal(SIGPIPE, before);
  if (!drawn)
    throw Error(ExitCode::failed, without + "gnuplot made no picture (Debian: gnuplot-nox)");
}

void write_chart(const std::string& folder, const std::string& name, const std::string& csv,
                 const std::string& script) {
  write_atomically(folder + "/" + name + ".csv", csv);
  write_atomically(folder + "/" + name + ".gp", script);
  run_gnuplot("load '" + name + ".gp'\n", folder, folder + "/" + name + ".csv is written, but ");
}

}  // namespace echofuse

// SPDX-License-Identifier: MIT
#include "drivers/core/gnuplot.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdio>
#include <fstream>

#include "drivers/core/exit_code.hpp"

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

// What was there stays until all of the new is.
void replace_file(const std::string& path, const std::string& text) {
  const std::string part = path + ".part";
  std::ofstream out(part);
  out << text;
  out.close();
  if (!out || std::rename(part.c_str(), path.c_str()) != 0)
    throw Error(ExitCode::disk, path + ": cannot be written");
}

}  // namespace

void run_gnuplot(const std::string& script, const std::string& folder, const std::string& without) {
  std::array<int, 2> ends{};
  if (::pipe(ends.data()) != 0) throw Error(ExitCode::failed, without + "no pipe to gnuplot");
  const auto before = std::signal(SIGPIPE, SIG_IGN);
  const pid_t child = ::fork();
  if (child == 0) {
    ::dup2(ends[0], STDIN_FILENO);
    ::close(ends[0]);
    ::close(ends[1]);
    if (::chdir(folder.c_str()) == 0) ::execlp("gnuplot", "gnuplot", nullptr);
    ::_exit(127);
  }
  ::close(ends[0]);
  write_all(ends[1], script);
  ::close(ends[1]);
  int status = 0;
  const bool ended = child > 0 && ::waitpid(child, &status, 0) == child;
  std::signal(SIGPIPE, before);
  if (!ended || status != 0)
    throw Error(ExitCode::failed, without + "gnuplot made no picture (Debian: gnuplot-nox)");
}

void write_chart(const std::string& folder, const std::string& name, const std::string& csv,
                 const std::string& script) {
  replace_file(folder + "/" + name + ".csv", csv);
  replace_file(folder + "/" + name + ".gp", script);
  run_gnuplot("load '" + name + ".gp'\n", folder, folder + "/" + name + ".csv is written, but ");
}

}  // namespace echofuse

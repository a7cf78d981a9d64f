// SPDX-License-Identifier: MIT
#include "drivers/util/console.hpp"

#include <signal.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>
#include <sstream>
#include <utility>

#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/program.hpp"

namespace echofuse {
namespace {

volatile sig_atomic_t signals_seen = 0;

void on_signal(int number) {
  if (signals_seen && number == SIGINT) _exit(static_cast<int>(ExitCode::interrupted));
  signals_seen = 1;
}

}  // namespace

int run_main(const std::string& program, const std::function<ExitCode()>& body) {
  const auto complain = [&](const char* what, ExitCode code) {
    std::string text = program + ": " + printable_lines(what);
    if (stderr_is_journal()) {  // each line becomes a journal entry with its own priority
      constexpr const char* error = "<3>";  // priority LOG_ERR, see sd-daemon(3)
      for (std::size_t at = 0; at != text.npos; at = text.find('\n', at + 1))
        text.insert(at == 0 ? 0 : at + 1, error);
    }
    std::fprintf(stderr, "%s\n", text.c_str());
    return static_cast<int>(code);
  };
  const auto deliver = [&](ExitCode code) {
    const bool failed = std::ferror(stdout) != 0;
    errno = 0;
    if (std::fflush(stdout) == 0 && !failed) return static_cast<int>(code);
    // errno of an earlier failed write is lost, so the write is repeated to set it
    if (errno == 0) {
      std::clearerr(stdout);
      std::fputc('\n', stdout);
      std::fflush(stdout);
    }
    if (errno == EPIPE) return static_cast<int>(code);
    const std::string why = errno != 0 ? std::string(": ") + std::strerror(errno) : "";
    return complain(("stdout: cannot write" + why).c_str(),
                    code == ExitCode::ok ? ExitCode::failed : code);
  };
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return deliver(body());
  } catch (const Error& e) {
    return complain(e.what(), e.code());
  } catch (const std::filesystem::filesystem_error& e) {
    const std::string where = e.path1().empty() ? "" : e.path1().string() + ": ";
    return complain((where + e.code().message()).c_str(), ExitCode::failed);
  } catch (const std::exception& e) {
    return complain(e.what(), ExitCode::failed);
  }
}

// Compares device and inode, as the documentation of sd_journal requires. A child process inherits
// JOURNAL_STREAM even if its stderr is another file.
bool stderr_is_journal() {
  const char* stream = std::getenv("JOURNAL_STREAM");
  struct stat is {};
  if (!stream || ::fstat(STDERR_FILENO, &is) != 0) return false;
  return std::to_string(is.st_dev) + ":" + std::to_string(is.st_ino) == stream;
}

void catch_interrupts() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigemptyset(&action.sa_mask);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  struct sigaction hangup {};
  sigaction(SIGHUP, nullptr, &hangup);
  if (hangup.sa_handler != SIG_IGN) sigaction(SIGHUP, &action, nullptr);
  // a handler instead of SIG_IGN, which child processes would inherit
  action.sa_handler = [](int) {};
  sigaction(SIGPIPE, &action, nullptr);
}

bool interrupted() { return signals_seen != 0; }

Progress::Progress(std::string title, std::size_t total, bool quiet)
    : title_(std::move(title)),
      total_(total),
      quiet_(quiet),
      terminal_(isatty(STDERR_FILENO) != 0),
      start_(SteadyClock::now()),
      last_(start_) {}

Progress::~Progress() {
  if (drawn_ && terminal_) std::fputc('\n', stderr);
}

std::string progress_line(const std::string& title, double share, const std::string& counts,
                          const std::string& text, std::size_t columns) {
  // `brackets`: total width of the bar's brackets and spaces
  constexpr std::size_t widest = 30, narrowest = 5, brackets = 4;
  const auto room = [&](const std::string& behind) {
    const std::size_t taken = title.size() + brackets + behind.size();
    return columns > taken ? std::min(columns - taken, widest) : 0;
  };
  const std::string& behind = room(text) >= narrowest ? text : counts;
  std::string out = title + ' ';
  if (const std::size_t width = room(behind); width >= narrowest) {
    std::string bar(static_cast<std::size_t>(share * static_cast<double>(width)), '#');
    bar.resize(width, '.');
    out += '[' + bar + "] ";
  }
  return (out + behind).substr(0, columns);
}

std::string wrapped(const std::string& lines, std::size_t columns) {
  std::istringstream in(lines);
  std::string out;
  for (std::string line; std::getline(in, line); out += line + '\n') {
    const std::size_t begin = line.find_first_not_of(' '), gap = line.find("  ", begin);
    std::size_t text = gap == line.npos ? begin : line.find_first_not_of(' ', gap);
    const std::size_t indent =
        std::min(gap == line.npos || text > columns / 2 ? begin + 2 : text, columns / 2);
    while (line.size() > columns && begin < columns) {
      std::size_t at = line.rfind(' ', columns);
      if (at == line.npos || at < text) at = line.find(' ', std::max(text, columns));
      const std::size_t next = line.find_first_not_of(' ', at);
      if (next == line.npos) break;
      out += line.substr(0, line.find_last_not_of(' ', at) + 1) + '\n';
      line = std::string(indent, ' ') + line.substr(next);
      text = indent;
    }
  }
  return out;
}

std::size_t columns_of_stdout() {
  winsize size{};
  const char* stated = std::getenv("COLUMNS");
  if (stated != nullptr && std::atoi(stated) > 0)
    return static_cast<std::size_t>(std::atoi(stated));
  return ::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 ? size.ws_col : 0;
}

void print(const std::string& lines) {
  const std::size_t columns = ::isatty(STDOUT_FILENO) ? columns_of_stdout() : 0;
  std::fputs((columns > 0 ? wrapped(lines, columns) : lines).c_str(), stdout);
  if (columns == 0 && !lines.ends_with('\n')) std::fputc('\n', stdout);
}

std::size_t columns_of_terminal() {
  winsize size{};
  constexpr std::size_t usual = 80;
  const bool known = ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  return known ? size.ws_col : usual;
}

void Progress::update(std::size_t done, const std::string& note) {
  if (quiet_) return;
  const auto now = SteadyClock::now();
  const bool last = done >= total_;
  const auto pause = terminal_ ? std::chrono::milliseconds(100) : std::chrono::milliseconds(10'000);
  if (!last && now - last_ < pause) return;
  last_ = now;
  const double spent = std::chrono::duration<double>(now - start_).count();
  const double share = total_ ? static_cast<double>(done) / static_cast<double>(total_) : 1.0;
  const std::string time =
      last ? human_duration(spent) : "ETA " + human_duration(share > 0 ? spent / share - spent : 0);
  const std::string counts = std::to_string(done) + '/' + std::to_string(total_) + "  " + time;
  const std::string text = counts + (note.empty() ? "" : "  " + note);
  if (terminal_)
    std::fprintf(stderr, "\r\033[K%s",
                 progress_line(title_, share, counts, text, columns_of_terminal() - 1).c_str());
  else
    std::fprintf(stderr, "%s %s\n", title_.c_str(), text.c_str());
  std::fflush(stderr);
  drawn_ = true;
}

std::string human_duration(double seconds) {
  if (seconds < 10) return format("%.1f s", seconds);
  const long whole = static_cast<long>(seconds + 0.5);
  if (whole < 60) return format("%ld s", whole);
  if (whole < 3600) return format("%ld min %ld s", whole / 60, whole % 60);
  return format("%ld h %ld min", whole / 3600, whole / 60 % 60);
}

const char* version() { return ECHOFUSE_VERSION; }
std::string version_line(const std::string& program) {
  return program + " " + version() + " (" + commit() + "), " + instruction_set();
}

}  // namespace echofuse

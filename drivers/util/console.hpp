// SPDX-License-Identifier: MIT
// Terminal output of all programs: one-line errors, signals, progress.
#pragma once
#include <chrono>
#include <cstddef>
#include <functional>
#include <string>

#include "drivers/util/exit_code.hpp"

namespace echofuse {

// Runs `body` and returns its exit code. Prints an exception as "PROGRAM: text" on stderr. Also
// reports a failed write to stdout (exit code `failed`), unless the reader has closed the pipe.
// Exceeding the file size limit (RLIMIT_FSIZE) causes a write error instead of a signal.
int run_main(const std::string& program, const std::function<ExitCode()>& body);

// Returns true if stderr is connected to systemd's journal. The journal adds the time to each line,
// and interprets "<N>" at the start of a line as its priority (syslog numbers).
bool stderr_is_journal();

// Makes SIGINT, SIGTERM and SIGHUP set the flag returned by interrupted(). A second SIGINT ends the
// process immediately (exit code 130). SIGHUP remains ignored under nohup. SIGPIPE is ignored.
void catch_interrupts();
bool interrupted();

// Breaks lines at spaces so that they have at most `columns` characters. Continuation lines are
// indented to the text that follows the first gap of two spaces.
std::string wrapped(const std::string& lines, std::size_t columns);
// Returns $COLUMNS if it is set, otherwise the width of the terminal at stdout, or 0 if neither is
// known.
std::size_t columns_of_stdout();
// Writes lines to stdout. Wraps them if stdout is a terminal. Adds a final newline if it is
// missing.
void print(const std::string& lines);

// Returns the width of the terminal at stderr, or 80 if it is not known.
std::size_t columns_of_terminal();
// Returns a line of at most `columns` characters: the title, a progress bar and `text`. `share` is
// the filled fraction of the bar. On a narrow terminal, `counts` replaces `text`, or the bar is
// omitted.
std::string progress_line(const std::string& title, double share, const std::string& counts,
                          const std::string& text, std::size_t columns);

// Shows a progress bar with the ETA on a terminal; otherwise, prints a plain line every 10 s. Shows
// nothing if `quiet` is set.
class Progress {
 public:
  Progress(std::string title, std::size_t total, bool quiet = false);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  // `note` is shown after the bar, for example "loss 0.123".
  void update(std::size_t done, const std::string& note = {});

 private:
  using SteadyClock = std::chrono::steady_clock;
  std::string title_;
  std::size_t total_;
  bool quiet_, terminal_, drawn_ = false;
  SteadyClock::time_point start_, last_;
};

// Formats a duration, for example "1 min 15 s" for 75.3.
std::string human_duration(double seconds);

// Returns the program's version as defined in CMakeLists.txt.
const char* version();
// Returns the commit from which the program was built, for example "d8b7bc3f0". Appends "+" if
// source files were modified (commit.cmake).
const char* commit();
// Returns the output of --version, for example "echofuse-sim 0.1.0 (d8b7bc3f0), AVX2".
std::string version_line(const std::string& program);

}  // namespace echofuse

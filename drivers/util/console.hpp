// SPDX-License-Identifier: MIT
// Terminal output of all programs: one-line errors, signals, progress.
#pragma once
#include <chrono>
#include <cstddef>
#include <functional>
#include <string>

#include "drivers/util/exit_code.hpp"

namespace echofuse {

// Runs body and returns its exit code. Prints an exception as one line "PROGRAM: text" on stderr.
// Reports a failed write to stdout in the same way (code failed), unless the reader closed the
// pipe. A file size limit (RLIMIT_FSIZE) becomes a write error instead of a signal.
int run_main(const std::string& program, const std::function<ExitCode()>& body);

// Returns true if stderr goes to systemd's journal. The journal adds the time and takes "<N>" at
// the start of a line as its priority (syslog numbers).
bool stderr_is_journal();

// SIGINT, SIGTERM and SIGHUP set a flag; a second SIGINT ends the process at once (exit code 130).
// SIGHUP stays ignored under nohup. SIGPIPE is ignored.
void catch_interrupts();
bool interrupted();

// Breaks lines at spaces to at most `columns`. Continuation lines are indented to the text after
// the first gap of two spaces.
std::string wrapped(const std::string& lines, std::size_t columns);
// Returns the width of the terminal at stdout, or $COLUMNS; 0 if neither is known.
std::size_t columns_of_stdout();
// Writes lines to stdout, wrapped on a terminal. Adds a final newline if it is missing.
void print(const std::string& lines);

// Returns the width of the terminal at stderr; 80 if unknown.
std::size_t columns_of_terminal();
// Returns a line of at most `columns` with a bar of `share`, then `text`. A narrow terminal gets
// only `counts`, or no bar.
std::string progress_line(const std::string& title, double share, const std::string& counts,
                          const std::string& text, std::size_t columns);

// Shows a bar with ETA on a terminal, a plain line every 10 s elsewhere; nothing when quiet.
class Progress {
 public:
  Progress(std::string title, std::size_t total, bool quiet = false);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  // `note` is shown after the bar ("loss 0.123").
  void update(std::size_t done, const std::string& note = {});

 private:
  using SteadyClock = std::chrono::steady_clock;
  std::string title_;
  std::size_t total_;
  bool quiet_, terminal_, drawn_ = false;
  SteadyClock::time_point start_, last_;
};

// 75.3 -> "1 min 15 s"
std::string human_duration(double seconds);

// Returns the program's version, from CMakeLists.txt.
const char* version();
// Returns the commit of the sources, "d8b7bc3f0", with "+" if files were modified (commit.cmake).
const char* commit();
// Returns the text of --version: "echofuse-sim 0.1.0 (d8b7bc3f0)".
std::string version_line(const std::string& program);

}  // namespace echofuse

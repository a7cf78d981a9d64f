// SPDX-License-Identifier: MIT
// Terminal output of all programs: one-line errors, signals, progress.
#pragma once
#include <chrono>
#include <cstddef>
#include <functional>
#include <string>

#include "drivers/program/exit_code.hpp"

namespace echofuse {

// Runs body and returns its exit code; an exception becomes one line "PROGRAM: text" on stderr, and
// so does stdout that cannot be written (code failed), unless its reader is gone. A limit on the
// size of files is an error of the file, not the end of the process.
int run_main(const std::string& program, const std::function<ExitCode()>& body);

// True if stderr goes to systemd's journal. The journal keeps the time by itself and takes "<N>" in
// front of a line as its priority (syslog's numbers).
bool stderr_is_journal();

// SIGINT, SIGTERM and SIGHUP set a flag; a second SIGINT ends the process at once (exit code 130).
// SIGHUP stays ignored where nohup ignores it. A reader that goes away costs the output only.
void catch_interrupts();
bool interrupted();

// Lines of at most `columns`, broken at spaces: a longer one goes on below its text, which begins
// behind the first gap of two spaces.
std::string wrapped(const std::string& lines, std::size_t columns);
// Columns of the terminal at stdout, or $COLUMNS; 0 if neither is known.
std::size_t columns_of_stdout();
// Writes lines to stdout, wrapped if that is a terminal. Adds a newline where the text ends in
// none.
void print(const std::string& lines);

// Width of the terminal at stderr; 80 if unknown.
std::size_t columns_of_terminal();
// Makes a line of at most `columns`: a bar of `share` with `text` behind it. A narrow terminal gets
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
  // `note` is shown behind the bar ("loss 0.123").
  void update(std::size_t done, const std::string& note = {});

 private:
  using Clock = std::chrono::steady_clock;
  std::string title_;
  std::size_t total_;
  bool quiet_, terminal_, drawn_ = false;
  Clock::time_point start_, last_;
};

// 75.3 -> "1 min 15 s"
std::string human_duration(double seconds);

// The program's version, as in CMakeLists.txt.
const char* version();
// The commit of the sources, "d8b7bc3f0"; with "+" if they were changed since (commit.cmake).
const char* commit();
// Line that --version prints: "echofuse-sim 0.1.0 (d8b7bc3f0)".
std::string version_line(const std::string& program);

}  // namespace echofuse

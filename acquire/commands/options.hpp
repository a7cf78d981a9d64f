// SPDX-License-Identifier: MIT
#pragma once
#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

#include "acquire/calibrate/calibrate.hpp"
#include "acquire/import/import.hpp"
#include "acquire/run/daemon.hpp"

namespace echofuse::acquire {

struct Options {
  std::string config;  // path of the configuration file; empty: the first file found
  std::vector<std::string> assignments;
  RunOptions run;
  CalibrateOptions calibrate;
  ImportOptions import;
  std::optional<std::string> label, text;
  std::vector<std::string> meta;
  std::string model;
  std::string reflector = "detector", only, side;  // options of `calibrate`
  double duration_s = 0, every_s = 0;
  std::string file, folder;
  bool json = false, quiet = false, verbose = false, view = false, align = false;
};

// Defines all commands. Parsed values are stored in `options`, which must outlive `app`.
void add_commands(CLI::App& app, Options& options);

// Returns the chosen command with its subcommand, e.g. "run" or "config show".
std::string command_of(const CLI::App& app);

}  // namespace echofuse::acquire

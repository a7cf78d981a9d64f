// SPDX-License-Identifier: MIT
// These are the sub-commands of echofuse-recon. Each adds its options to a parser and returns the
// function to call once they are read.
#pragma once
#include <functional>

#include "drivers/program/exit_code.hpp"

namespace CLI {
class App;
}

namespace echofuse::recon {

struct Common {
  int threads = 0;  // threads of the matrix product; 0: one per core
  bool quiet = false;
};

using Command = std::function<ExitCode()>;

Command add_train(CLI::App& app, const Common& common);
Command add_evaluate(CLI::App& app, const Common& common);
Command add_reconstruct(CLI::App& app, const Common& common);
Command add_report(CLI::App& app, const Common& common);
Command add_study(CLI::App& app, const Common& common);

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
// Subcommands of echofuse-recon. Each add_ function adds the options to a parser and returns the
// function to call after parsing.
#pragma once
#include <functional>
#include <string>

#include "drivers/util/exit_code.hpp"
#include "recon/predict/trained_model.hpp"

namespace CLI {
class App;
}

namespace echofuse::recon {

struct Common {
  int threads = 0;  // number of threads for matrix products; 0: one per core
  bool quiet = false;
};

using Command = std::function<ExitCode()>;

Command add_train(CLI::App& app, const Common& common);
Command add_evaluate(CLI::App& app, const Common& common);
Command add_rows(CLI::App& app, const Common& common);
Command add_compare(CLI::App& app, const Common& common);
Command add_reconstruct(CLI::App& app, const Common& common);

void add_range_offset_option(CLI::App& app, double& offset_m);
void add_empty_option(CLI::App& app, std::string& path);
// Loads a model and prints notes about it to stderr. If `empty` is the path of a run, adapts the
// model to the empty room recorded in that run.
TrainedModel model_for_room(const std::string& path, const std::string& empty,
                            double range_offset_m);

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
// Sub-commands of echofuse-recon. Each adds its options to a parser and returns the function to
// call once they are read.
#pragma once
#include <functional>
#include <string>

#include "drivers/program/exit_code.hpp"
#include "recon/use/trained_model.hpp"

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
Command add_rows(CLI::App& app, const Common& common);
Command add_compare(CLI::App& app, const Common& common);
Command add_reconstruct(CLI::App& app, const Common& common);

// Options that several commands have.
void add_range_offset_option(CLI::App& app, double& offset_m);
void add_empty_option(CLI::App& app, std::string& path);
// Reads a model and takes it to the room of the run of nobody, if there is one; says so on stderr.
TrainedModel model_for_room(const std::string& path, const std::string& empty,
                            double range_offset_m);

}  // namespace echofuse::recon

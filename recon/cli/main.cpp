// SPDX-License-Identifier: MIT
// echofuse-recon: trains models on runs, reconstructs depth maps and evaluates them.
#include <CLI/CLI.hpp>

#include "drivers/util/command_line.hpp"
#include "drivers/util/console.hpp"
#include "recon/cli/commands.hpp"
#include "recon/numbers/blas.hpp"
#include "recon/numbers/parallel.hpp"

namespace {
using namespace echofuse;
using namespace echofuse::recon;

int run(int argc, char** argv) {
  CLI::App app("train models, reconstruct depth maps, and evaluate models or maps",
               "echofuse-recon");
  app.set_version_flag("--version", version_line("echofuse-recon") + ", matrix kernels " +
                                        blas_kernels() + " (" + blas_instructions() + ")");
  app.require_subcommand(1);
  Common common;
  Command chosen;
  app.add_option("--threads", common.threads, "number of threads; 0: one thread per CPU core")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  app.add_flag("-q,--quiet", common.quiet, "print errors and warnings only");
  const auto add = [&](const char* name, const char* help, auto make) {
    CLI::App* sub = app.add_subcommand(name, help);
    const Command command = make(*sub, common);
    sub->callback([&chosen, command] { chosen = command; });
  };
  add("train", "train a model on one or more runs", add_train);
  add("rows",
      "list the training, validation and test records, and the reasons why other records are "
      "excluded",
      add_rows);
  add("evaluate", "score one or more models on a run", add_evaluate);
  add("compare",
      "print confidence intervals of the scores, and paired differences between the models",
      add_compare);
  add("reconstruct", "reconstruct the depth maps of a run", add_reconstruct);
  try {
    parse_command_line(app, argc, argv);
  } catch (const CLI::ParseError& e) {
    return run_main("echofuse-recon",
                    [&] { return app.exit(e) == 0 ? ExitCode::ok : ExitCode::usage; });
  }
  return run_main("echofuse-recon", [&] {
    // `evaluate` writes only one file, at the end. The first Ctrl-C therefore stops it immediately.
    if (!app.got_subcommand("evaluate")) catch_interrupts();
    set_threads(common.threads);
    return chosen();
  });
}

}  // namespace

int main(int argc, char** argv) { return run(argc, argv); }

// SPDX-License-Identifier: MIT
// echofuse-recon goes from records to a model, to depth maps, to scores.
#include <CLI/CLI.hpp>

#include "drivers/program/command_line.hpp"
#include "drivers/program/console.hpp"
#include "recon/cli/commands.hpp"
#include "recon/numbers/blas.hpp"
#include "recon/numbers/parallel.hpp"

namespace {
using namespace echofuse;
using namespace echofuse::recon;

int run(int argc, char** argv) {
  CLI::App app("records to model to depth maps", "echofuse-recon");
  app.set_version_flag("--version", version_line("echofuse-recon") + ", matrix kernels " +
                                        blas_kernels() + " (" + blas_instructions() + ")");
  app.require_subcommand(1);
  Common common;
  Command chosen;
  app.add_option("--threads", common.threads, "of every command; 0: one per core")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  app.add_flag("-q,--quiet", common.quiet, "of every command: no progress, no talk");
  const auto add = [&](const char* name, const char* help, auto make) {
    CLI::App* sub = app.add_subcommand(name, help);
    const Command command = make(*sub, common);
    sub->callback([&chosen, command] { chosen = command; });
  };
  add("train", "fit a model to runs", add_train);
  add("rows", "which records train, validate and test, and why others are left out", add_rows);
  add("evaluate", "score a model on a run", add_evaluate);
  add("compare", "intervals and paired differences of scores by record", add_compare);
  add("reconstruct", "depth maps of a run as pictures", add_reconstruct);
  try {
    parse_command_line(app, argc, argv);
  } catch (const CLI::ParseError& e) {
    return run_main("echofuse-recon",
                    [&] { return app.exit(e) == 0 ? ExitCode::ok : ExitCode::usage; });
  }
  return run_main("echofuse-recon", [&] {
    // `evaluate` only reads, and writes one file at the end: the first Ctrl-C ends it at once.
    if (!app.got_subcommand("evaluate")) catch_interrupts();
    set_threads(common.threads);
    return chosen();
  });
}

}  // namespace

int main(int argc, char** argv) { return run(argc, argv); }

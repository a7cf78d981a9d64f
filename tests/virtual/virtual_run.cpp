// SPDX-License-Identifier: MIT
// virtual_run --out RUN --slots N [--window S] [--faults FILE] [--log FILE] [--seed N] [--name
// NAME]: records a run of a simulated laboratory in virtual time and prints the processor time in
// seconds.
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>

#include "../fixtures/laboratory.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/settings.hpp"

namespace {

using namespace echofuse;

ExitCode run(int argc, char** argv) {
  acquire::RunOptions options;
  test::LaboratoryOptions laboratory;
  std::string faults;
  std::int64_t slots = 0;
  CLI::App app;
  app.add_option("--out", options.out)->required();
  app.add_option("--slots", slots)->required();
  app.add_option("--window", laboratory.window_s);
  app.add_option("--hold", laboratory.hold_s);
  app.add_option("--faults", faults);
  app.add_option("--log", laboratory.log);
  app.add_option("--seed", laboratory.seed);
  app.add_option("--name", laboratory.name);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? ExitCode::ok : ExitCode::usage;
  }
  spdlog::set_level(spdlog::level::off);
  options.out = std::filesystem::absolute(options.out).string();
  options.count = slots;
  laboratory.folder = std::filesystem::path(options.out).parent_path().string();
  if (!faults.empty()) laboratory.faults = sim::read_faults(read_config_text(faults), faults);
  test::Laboratory lab(laboratory);
  const ExitCode code = lab.record(options);
  lab.close();
  std::printf("%.1f\n", static_cast<double>(std::clock()) / CLOCKS_PER_SEC);
  return code;
}

}  // namespace

int main(int argc, char** argv) {
  return echofuse::run_main("virtual_run", [&] { return run(argc, argv); });
}

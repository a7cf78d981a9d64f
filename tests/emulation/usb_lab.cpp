// SPDX-License-Identifier: MIT
// usb_lab [--dir DIR] [--scene KIND] [--hold S] [--window S] -- COMMAND ...: runs the command in a
// simulated laboratory with an emulated USB time tagger.
#include <CLI/CLI.hpp>

#include "drivers/util/console.hpp"
#include "sim/lab/lab.hpp"
#include "tests/emulation/tdc_usb.hpp"

namespace {

using namespace echofuse;

ExitCode run(int argc, char** argv) {
  sim::UsbBed::enter(argv);
  catch_interrupts();
  sim::LabOptions options;
  std::vector<std::string> command;
  CLI::App app;
  app.add_option("--dir", options.dir);
  app.add_option("--scene", options.schedule.kind);
  app.add_option("--hold", options.schedule.hold_s);
  app.add_option("--window", options.window_s);
  app.add_option("command", command)->required();
  app.parse(argc, argv);
  // Adds noise, because no two frames of a real camera are equal.
  options.conditions.depth_noise_m = 0.0005;
  sim::UsbBed bed;
  options.make_tagger = [&](auto& loop, auto& player, const auto& expected) {
    return sim::LabTagger{sim::make_tdc_usb(loop, player, bed, expected), sim::tdc_usb_address,
                          bed.environment()};
  };
  port::SystemLoop loop;
  sim::Lab lab(loop, options);
  return sim::serve_command(lab, command);
}

}  // namespace

int main(int argc, char** argv) {
  return echofuse::run_main("usb_lab", [&] { return run(argc, argv); });
}

// SPDX-License-Identifier: MIT
#include "recon/study/simulate.hpp"

#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "drivers/program/atomic_write.hpp"
#include "drivers/program/console.hpp"
#include "drivers/program/program.hpp"
#include "drivers/program/staged_file.hpp"
#include "recon/data/files.hpp"
#include "recon/numbers/text.hpp"

namespace echofuse::recon {
namespace {

// Half of the bodies at x, half at -x; of every eight two are people without a letter.
std::string scene_list(double x_m, std::size_t records) {
  std::string out;
  for (std::size_t i = 0; i < records; ++i)
    out += formatted("[[scene]]\nkind = \"%s\"\nx_m = %.9g\n", i % 8 < 2 ? "person" : "letter",
                     i % 2 ? x_m : -x_m);
  return out;
}

void run(const std::vector<std::string>& words, int output = STDOUT_FILENO) {
  const auto child = start_program(words, {.output = output});
  if (!child)
    throw Error(ExitCode::failed, words[0] + ": " + child.failure().code.message() +
                                      "; name the simulator with --sim");
  const int code = wait_for_program(*child);
  if (interrupted()) throw Error(ExitCode::interrupted, "interrupted");
  if (code == 0) return;
  std::string line;
  for (const auto& word : words) line += (line.empty() ? "" : " ") + word;
  throw Error(ExitCode::failed, line + (code > 128 ? formatted(": ended by signal %d", code - 128)
                                                   : formatted(": exit code %d", code)));
}

}  // namespace

Simulator::Simulator(std::string program, std::string folder, int threads,
                     std::vector<std::string> set)
    : program_(program.empty() ? program_beside("echofuse-sim") : std::move(program)),
      folder_(std::move(folder)),
      threads_(threads),
      set_(std::move(set)) {}

BaseCondition Simulator::base_condition() const {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> text(std::tmpfile(), std::fclose);
  if (!text) throw Error(ExitCode::disk, "no temporary file for the simulator's settings");
  std::vector<std::string> words = {program_, "config", "--json"};
  for (const auto& assignment : set_) words.insert(words.end(), {"--set", assignment});
  run(words, ::fileno(text.get()));
  std::rewind(text.get());
  const auto settings = nlohmann::json::parse(text.get(), nullptr, false);
  if (!settings.is_object())
    throw Error(ExitCode::failed, program_ + " config --json: printed no JSON object");
  BaseCondition out;
  for (const auto& [key, setting] : settings.items())
    if (const auto value = setting.find("value"); value != setting.end()) {
      if (value->is_number()) out[key] = value->get<double>();
      if (value->is_string()) out[key + "=" + value->get<std::string>()] = 1;
    }
  return out;
}

Dataset Simulator::make(const World& world, std::size_t records, std::uint64_t seed) const {
  const std::string stem =
      scratch_folder(folder_) + "/.simulated-" + machine_name() + "-" + std::to_string(::getpid());
  const TemporaryFile run_file{stem + ".sqlite"}, list{stem + ".toml"};
  std::vector<std::string> words = {program_, "dataset",           "-q", "--out", run_file.path,
                                    "--seed", std::to_string(seed)};
  if (threads_ > 0) words.insert(words.end(), {"--threads", std::to_string(threads_)});
  for (const auto* set : {&set_, &world.set})
    for (const auto& assignment : *set) words.insert(words.end(), {"--set", assignment});
  if (world.at_x_m) {
    write_atomically(list.path, scene_list(*world.at_x_m, records));
    words.insert(words.end(), {"--set", "scenes=" + list.path});
  } else {
    words.insert(words.end(), {"--" + world.scenes, std::to_string(records)});
  }
  run(words);
  Dataset data = load({run_file.path});
  apply(world, data);
  return data;
}

}  // namespace echofuse::recon

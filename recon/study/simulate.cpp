// SPDX-License-Identifier: MIT
#include "recon/study/simulate.hpp"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "drivers/core/random.hpp"
#include "drivers/program/console.hpp"
#include "drivers/program/new_file.hpp"
#include "drivers/program/program.hpp"
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

// The same people as in every list of this seed, so far along their ways from the middle.
std::string walk_list(const BaseCondition& base, double way_m, std::size_t records,
                      std::uint64_t seed) {
  Rng rng = make_rng(seed, 0x77616c6b);  // "walk"
  const auto any = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(rng);
  };
  const double side_m = base.at("target_x_m");
  std::string out;
  for (std::size_t i = 0; i < records; ++i) {
    const double x = any(-side_m, side_m), turn = any(0, 2 * std::numbers::pi);
    const double z = any(base.at("target_z_min_m"), base.at("target_z_max_m"));
    out += formatted("[[scene]]\nkind = \"%s\"\nx_m = %.9g\nz_m = %.9g\n",
                     i % 4 == 0 ? "person" : "letter", x + way_m * std::cos(turn),
                     z + way_m * std::sin(turn));
  }
  return out;
}

void add(Matrix& sum, const Matrix& more) {
  std::ranges::transform(sum.values, more.values, sum.values.begin(), std::plus());
}

std::vector<std::string> assignments(const std::vector<std::string>& set) {
  std::vector<std::string> out;
  for (const auto& assignment : set) out.insert(out.end(), {"--set", assignment});
  return out;
}

std::vector<std::string> joined(std::vector<std::string> words,
                                const std::vector<std::string>& more) {
  words.insert(words.end(), more.begin(), more.end());
  return words;
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
  run(joined({program_, "config", "--json"}, assignments(set_)), ::fileno(text.get()));
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
  Dataset data;
  if (world.walks_m > 0)
    data = walkers(world, records, seed);
  else if (world.at_x_m)
    data = simulate(assignments(world.set), scene_list(*world.at_x_m, records), seed);
  else
    data = simulate(joined(assignments(world.set), {"--" + world.scenes, std::to_string(records)}),
                    "", seed);
  apply(world, data);
  return data;
}

// A walk is a sum of short records in which the same people stand, a step further in each. Their
// photons add up, and the radar's power is the mean over all frames.
Dataset Simulator::walkers(const World& world, std::size_t records, std::uint64_t seed) const {
  constexpr int steps = 5;
  const BaseCondition base = base_condition();
  const auto share = [&](const char* key) {
    return formatted("%s=%.9g", key, std::max(1., std::round(base.at(key) / steps)));
  };
  std::vector<std::string> set = world.set;
  for (const char* key : {"signal_photons", "background_counts", "radar_frames"})
    if (base.at(key) > 0) set.push_back(share(key));
  Dataset out;
  for (const int step : {0, -2, -1, 1, 2}) {
    const double way_m = world.walks_m * step / steps;
    const Dataset part = simulate(assignments(set), walk_list(base, way_m, records, seed), seed);
    if (step == 0) {
      out = part;
    } else {
      add(out.spd, part.spd), add(out.radar, part.radar), add(out.array, part.array);
    }
  }
  for (Matrix* table : {&out.radar, &out.array})
    for (float& value : table->values) value /= steps;
  return out;
}

Dataset Simulator::simulate(const std::vector<std::string>& more, const std::string& scenes,
                            std::uint64_t seed) const {
  const std::string stem =
      scratch_folder(folder_) + "/.simulated-" + machine_name() + "-" + std::to_string(::getpid());
  const TemporaryFile run_file{stem + ".sqlite"}, list{stem + ".toml"};
  std::vector<std::string> words = {program_, "dataset",           "-q", "--out", run_file.path,
                                    "--seed", std::to_string(seed)};
  if (threads_ > 0) words.insert(words.end(), {"--threads", std::to_string(threads_)});
  words = joined(joined(std::move(words), assignments(set_)), more);
  if (!scenes.empty()) {
    write_atomically(list.path, scenes);
    words.insert(words.end(), {"--set", "scenes=" + list.path});
  }
  run(words);
  return load({run_file.path});
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <thread>
#include <utility>

#include "acquire/record/run_file.hpp"
#include "drivers/core/console.hpp"
#include "recon/cli/commands.hpp"
#include "recon/estimator/learning_curve.hpp"

namespace echofuse::recon {
namespace {

struct Arguments {
  std::string run, from, split = "random";
  std::uint64_t seed = 1;
  bool watch = false;
};

constexpr std::chrono::milliseconds pause_between_looks(500);

// Steps of the curve that the run has come to.
class Learner {
 public:
  explicit Learner(const Arguments& a) : a_(a), from_(load_model(a.from)) {
    options_.split.validation_share = options_.split.test_share = 0;
    options_.split.kind = a.split;
    options_.split.seed = options_.tuning.seed = a.seed;
  }
  // At the end also all records, whatever their number.
  void look(bool at_the_end) {
    Dataset data = load({a_.run}, [](std::int64_t, const std::string&) {});
    const Rows usable = data.usable(from_.features.inputs);
    if (usable.size() < TuneOptions::least_records) {
      if (!at_the_end) return;
      throw Error(ExitCode::failed, std::to_string(usable.size()) +
                                        " usable records; at least 10 are needed to tune a model");
    }
    match_for_tuning(from_, a_.from, data);
    for (const std::size_t step : learning_steps(usable.size())) {
      const bool last = step == usable.size();
      if (interrupted() || step <= seen_ || (last && !at_the_end && !is_step(step))) continue;
      if (curve_.empty()) std::fputs(learning_header().c_str(), stdout);
      curve_.push_back(learn(from_, data, usable, step, options_));
      seen_ = step;
      std::printf("%s", to_text(curve_.back()).c_str());
      if (last || a_.watch) std::fputs(advice(curve_).c_str(), stdout);
      std::fflush(stdout);
    }
  }

 private:
  static bool is_step(std::size_t records) {
    const auto steps = learning_steps(records + 1);
    return std::find(steps.begin(), steps.end() - 1, records) != steps.end() - 1;
  }
  const Arguments& a_;
  TrainedModel from_;
  TuneOptions options_;
  std::vector<LearningPoint> curve_;
  std::size_t seen_ = 0;
};

}  // namespace

Command add_learn(CLI::App& app, const Common&) {
  const auto a = std::make_shared<Arguments>();
  app.add_option("run", a->run, "run file of the new room")->required();
  app.add_option("--from", a->from, "the model that is to be tuned to it")->required();
  app.add_option("--split", a->split, "of the cross-validation: random, or blocked for sequences")
      ->check(CLI::IsMember({"random", "blocked"}))
      ->capture_default_str();
  app.add_option("--seed", a->seed, "of order and folds")->capture_default_str();
  app.add_flag("--watch", a->watch,
               "of a run that is being recorded: goes on with its records until it is closed");
  return [a] {
    Learner learner(*a);
    std::int64_t looked_at = -1;  // records
    while (!interrupted()) {
      const auto [status, count] = [&] {
        const record::RunReader run(a->run);
        return std::pair(run.info().status, run.count());
      }();
      const bool open = a->watch && status == "open";
      if (!open || count != looked_at) learner.look(!open);
      if (!open) break;
      looked_at = count;
      std::this_thread::sleep_for(pause_between_looks);
    }
    return interrupted() ? ExitCode::interrupted : ExitCode::ok;
  };
}

}  // namespace echofuse::recon

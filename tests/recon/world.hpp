// SPDX-License-Identifier: MIT
// Functions that the tests of recon share. Most tests use a_run(). Its few bins and coarse plates
// let training take a fraction of a second.
#pragma once
#include <unistd.h>

#include <complex>
#include <csignal>
#include <nlohmann/json.hpp>
#include <span>

#include "../fixtures/damage.hpp"
#include "../fixtures/dataset.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/made.hpp"
#include "../fixtures/run.hpp"
#include "../fixtures/shell.hpp"
#include "recon/maps/png.hpp"
#include "recon/predict/predict.hpp"
#include "recon/score/evaluate.hpp"
#include "recon/train/train.hpp"
#include "recon/trust/out_of_distribution.hpp"

using Catch::Contains;
using Catch::EndsWith;
using Catch::StartsWith;

namespace echofuse::test {

// Calls `body`. Returns the message of the Error thrown by `body`, or "no error" if it does not
// throw.
inline std::string error_of(const std::function<void()>& body) {
  try {
    body();
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

// Returns the data of a_run(count, seed, change).
inline recon::Dataset load_plates(std::int64_t count, std::uint64_t seed = 1,
                                  const Change& change = {}) {
  if (!change) return recon::load({made_run(count, seed)});
  const Folder dir;
  return recon::load({a_run(count, seed, change).write(dir / "run")});
}

// Returns a cached model of a_run(records).
inline recon::TrainedModel trained_model(const std::string& kind, std::int64_t records,
                                         Words words = {}) {
  words.insert(words.begin(), {"--set", "fallback=false"});
  return recon::load_model(made_model(kind, records, 1, words));
}

// Returns a cached default run: `kind` is one_pixel or nine_zones.
inline std::string made_default_run(const std::string& kind, const char* records,
                                    const char* seed) {
  return made("fixture", {"run", "--kind", kind, "--records", records, "--seed", seed});
}

// Returns a cached model of 300 records of a default run.
inline std::string made_default_model(const std::string& kind, const std::string& inputs) {
  return made("echofuse-recon",
              {"train", "-q", "--model", "factorised-4", "--epochs", "30", "--inputs", inputs,
               "--set", "fallback=false", made_default_run(kind, "300", "1")});
}

inline bool all_finite(std::span<const float> values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

// Returns options that train the named model silently, without an uncertainty.
inline recon::TrainOptions quiet_options(const std::string& model,
                                         std::optional<std::size_t> epochs = {}) {
  recon::TrainOptions out;
  out.model = model, out.uncertainty = false, out.fit.epochs = epochs, out.fit.quiet = true;
  return out;
}

// Returns the mean scores of the maps that a model predicts for some records.
inline recon::Summaries scores_of(const recon::TrainedModel& model, const recon::Dataset& data,
                                  const recon::Rows& rows) {
  return recon::summarise(
      recon::score_maps(model.predict(data, rows), data, rows, model.first().scene));
}
inline recon::Summaries scores_of(const recon::TrainedModel& model, const recon::Dataset& data) {
  return scores_of(model, data, recon::all_rows(data.size()));
}

// Returns the share of the scores that are flagged with a reason that begins with `why`.
inline double share_flagged(const std::vector<recon::OutOfDistributionScore>& scores,
                            const std::string& why = "") {
  const auto flagged = std::ranges::count_if(
      scores, [&](const auto& s) { return !s.reason.empty() && s.text().starts_with(why); });
  return static_cast<double>(flagged) / static_cast<double>(scores.size());
}
inline double share_flagged(const std::vector<recon::PredictionUncertainty>& uncertainties,
                            const std::string& why = "") {
  std::vector<recon::OutOfDistributionScore> scores;
  for (const auto& u : uncertainties) scores.push_back(u.out_of_distribution);
  return share_flagged(scores, why);
}

// Fits a detector to rows of the training data. Returns the scores of the records of `of`.
inline std::vector<recon::OutOfDistributionScore> outlier_scores(const recon::Dataset& training,
                                                                 const recon::Rows& rows,
                                                                 const recon::Dataset& of) {
  using namespace recon;
  const Preprocessing p(training, rows, Inputs::fused,
                        learn_scene(depth_maps(training), rows, training.map), true);
  const OutOfDistributionDetector detector(p.alignment, training, p.views, rows, Inputs::fused,
                                           p.scene, 1);
  const Features raw = fit_features(training, rows, Inputs::fused, raw_scaling);
  const Rows all = all_rows(of.size());
  return detector.score(align(observe(of, all, raw), p.alignment), of, all);
}

// Returns an alignment that contains no background, because it was fitted to an empty record.
inline recon::Alignment blank_alignment(const Axis& radar = radar_axis()) {
  const recon::Layout layout{spd_axis(), radar};
  return {layout, recon::Matrix(1, layout.inputs()), {0}};
}

inline double bump(double off_m, double width_m) { return std::exp(-std::pow(off_m / width_m, 2)); }

// Returns the inputs for a record of one object, given its SPD range and its radar range.
inline std::vector<float> one_object(double range_m, double radar_range_m,
                                     const Axis& radar = radar_axis(), double radar_width_m = 0.4) {
  std::vector<float> out;
  for (std::uint32_t i = 0; i < spd_axis().count; ++i)
    out.push_back(static_cast<float>(1e4 * bump(spd_axis().at(i + 0.5) / ps_per_m - range_m, 0.2)));
  for (std::uint32_t i = 0; i < radar.count; ++i)
    out.push_back(static_cast<float>(bump(radar.at(i) - radar_range_m, radar_width_m)));
  return out;
}

// Adds the signals of a second body to a record: those of the record seven places further in
// `from`.
inline void add_body(recon::Dataset& to, std::size_t row, const recon::Dataset& from) {
  for (const auto& [table, other] :
       {std::pair(&photons(to), &photons(from)), {&profiles(to), &profiles(from)}})
    for (std::size_t c = 0; c < table->cols; ++c)
      table->row(row)[c] += other->row((row + 7) % from.size())[c];
}
inline recon::Dataset with_second_bodies(const recon::Dataset& data) {
  recon::Dataset two = data;
  for (std::size_t row = 0; row < two.size(); ++row) add_body(two, row, data);
  return two;
}

// Returns the depths in mm of a written depth picture, or nothing if it has another size.
inline std::vector<std::uint16_t> picture(const std::string& path, std::uint32_t size = 64) {
  const std::string png = contents(path);
  return recon::decode_png16(Bytes(png.begin(), png.end()), size, size);
}

// Folder in which echofuse-recon runs, so that its arguments are the names of files in this folder.
struct ReconFolder : Folder {
  Outcome run(const std::string& command) const {
    return shell("cd " + path.string() + " && " + command);
  }
  Outcome recon(const std::string& arguments) const {
    return run(bin_dir + "/echofuse-recon " + arguments);
  }
  // Returns the output of a command, which must have the exit code `code`.
  std::string done(const std::string& arguments, int code = 0) const {
    const Outcome o = recon(arguments);
    CAPTURE(arguments, o.text);
    REQUIRE(o.code == code);
    return o.text;
  }
  // Checks the exit code of a command, and that its output contains each of the texts. A line end
  // is put before the output, so that "\n..." also matches its first line.
  void says(const std::string& arguments, const Words& texts, int code = 0) const {
    const std::string output = "\n" + done(arguments, code);
    for (const std::string& text : texts) CHECK_THAT(output, Contains(text));
  }
  nlohmann::json json(const std::string& arguments) const {
    const std::string text = done("-q " + arguments + " --json");
    return nlohmann::json::parse(text.substr(text.find('{')));
  }
  // Checks the exit code and the error message of a command. The message must be a single line, or
  // at most three lines (including the usage) if the code is 2.
  void refuses(const std::string& arguments, int code, const std::string& saying) const {
    const Outcome o = recon(arguments);
    CAPTURE(arguments);
    CHECK(o.code == code);
    CHECK_THAT(o.text, Catch::Contains(saying));
    CHECK(std::count(o.text.begin(), o.text.end(), '\n') <= (code == 2 ? 3 : 1));
  }
};

// Starts echofuse-recon without waiting for it to exit. Writes its messages to the file `log`, if
// given.
inline pid_t start_recon(std::vector<std::string> words, const std::string& log = "") {
  words.insert(words.begin(), "echofuse-recon");
  std::vector<char*> arguments;
  for (auto& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    if (log.empty() || std::freopen(log.c_str(), "w", stderr))
      execv((bin_dir + "/echofuse-recon").c_str(), arguments.data());
    _exit(127);
  }
  return child;
}

// Sends a signal to a program, unless it is 0, and returns the exit code of the program.
inline int exit_code(pid_t child, int signal = 0) {
  kill(child, signal);
  int status = 0;
  waitpid(child, &status, 0);
  REQUIRE(WIFEXITED(status));
  return WEXITSTATUS(status);
}

}  // namespace echofuse::test

using namespace echofuse::recon;
using namespace echofuse::test;

// SPDX-License-Identifier: MIT
#include "recon/cli/commands.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "drivers/core/console.hpp"
#include "drivers/core/printable.hpp"
#include "recon/cli/options.hpp"
#include "recon/data/turpin.hpp"
#include "recon/estimator/crossvalidate.hpp"
#include "recon/estimator/empty_room.hpp"
#include "recon/estimator/evaluate.hpp"
#include "recon/estimator/predict.hpp"
#include "recon/estimator/train.hpp"
#include "recon/files/text.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/output/export_model.hpp"
#include "recon/output/map_files.hpp"
#include "recon/output/reconstruct.hpp"
#include "recon/output/report.hpp"
#include "recon/study/fold_file.hpp"

namespace echofuse::recon {
namespace {

void add_output_option(CLI::App& app, std::string& output) {
  app.add_option("--output", output, "own: the model's map; mean: over what may be there")
      ->check(CLI::IsMember(output_names))
      ->capture_default_str();
}

void add_range_bias_option(CLI::App& app, std::string& action) {
  app.add_option(
         "--range-bias", action,
         "what to do about a range bias of the radar against the SPD since the training: warn, "
         "correct (wrong if people stand further to one side), or ignore")
      ->check(CLI::IsMember(range_bias_action_names))
      ->capture_default_str();
}

// What this program was started with.
std::string command_line() {
  std::ifstream in("/proc/self/cmdline", std::ios::binary);
  std::string words(std::istreambuf_iterator<char>(in), {});
  if (!words.empty()) words.pop_back();
  std::replace(words.begin(), words.end(), '\0', ' ');
  const auto first = words.substr(0, words.find(' ')).rfind('/');
  return first == std::string::npos ? words : words.substr(first + 1);
}

void add_empty_option(CLI::App& app, std::string& path) {
  app.add_option("--empty", path,
                 "a run of nobody in the room of this run, if it is another one than in training");
}

TrainedModel model_for_room(const std::string& path, const std::string& empty) {
  TrainedModel model = load_model(path);
  const std::string text = empty.empty() ? "" : take_to_room(model, empty);
  if (!text.empty()) std::fprintf(stderr, "%s\n", text.c_str());
  return model;
}

// What reconstruct says of its records on stderr: while following at once, else at the end, which
// leaves the progress bar alone.
class ReconstructReport {
 public:
  ReconstructReport(std::string run, bool follow, bool quiet)
      : run_(std::move(run)), follow_(follow), quiet_(quiet) {}
  bool all_well() const { return left_out_ + notes_.size() == 0; }

  void add(const RecordStatus& r) {
    if (r.after_slot_s) after_slot_s_.push_back(*r.after_slot_s);
    (r.fault.empty() ? good_ : left_out_) += 1;
    if (!r.note.empty()) ++notes_[r.note];
    if (r.uncertainty && !r.uncertainty->note.empty()) ++bodies_[r.uncertainty->note];
    if (!r.fault.empty() && !follow_) faults_.push_back(r);
    if (r.uncertainty && !r.uncertainty->out_of_distribution.reason.empty())
      ++reasons_[r.uncertainty->out_of_distribution.reason];
    if (follow_ && !(r.fault.empty() && r.note.empty())) report(r);
    if (follow_ && r.uncertainty && !r.uncertainty->out_of_distribution.reason.empty() && !quiet_)
      std::fprintf(stderr, "record %lld: out of distribution: %s\n",
                   static_cast<long long>(r.index),
                   r.uncertainty->out_of_distribution.text().c_str());
    if (follow_ && r.after_slot_s && !quiet_)
      std::fprintf(stderr,
                   "record %lld: map %.3f s after its slot's end, %.1f ms after its reading\n",
                   static_cast<long long>(r.index), *r.after_slot_s, *r.after_reading_s * 1e3);
  }

  void finish(const std::string& out) {
    for (const auto& r : faults_) report(r);
    if (quiet_) return;
    std::fprintf(stderr, "%s: %zu records reconstructed, %zu left out", printable(out).c_str(),
                 good_, left_out_);
    for (const auto* counts : {&notes_, &bodies_})
      for (const auto& [note, count] : *counts)
        std::fprintf(stderr, "; %zu with %s", count, note.c_str());
    std::sort(after_slot_s_.begin(), after_slot_s_.end());
    if (!after_slot_s_.empty())
      std::fprintf(stderr, "; maps %.3f s after their slot's end (median; longest %.3f s)",
                   after_slot_s_[after_slot_s_.size() / 2], after_slot_s_.back());
    std::fputc('\n', stderr);
    if (!reasons_.empty()) list_reasons();
  }

 private:
  void list_reasons() const {
    std::size_t all = 0;
    std::string reasons;
    for (const auto& [reason, count] : reasons_) {
      all += count;
      reasons += formatted("%s%zu %s", reasons.empty() ? "" : "; ", count, reason.c_str());
    }
    std::fprintf(stderr, "%zu of %zu records are out of distribution: %s\n", all, good_,
                 reasons.c_str());
  }
  void report(const RecordStatus& r) const {
    std::fprintf(stderr, "%s: record %lld: %s\n", printable(run_).c_str(),
                 static_cast<long long>(r.index),
                 printable(r.fault.empty() ? r.note : r.fault).c_str());
  }
  std::string run_;
  bool follow_, quiet_;
  std::size_t good_ = 0, left_out_ = 0;
  std::vector<RecordStatus> faults_;
  std::vector<double> after_slot_s_;
  std::map<std::string, std::size_t> notes_, bodies_, reasons_;  // records for each
};

}  // namespace

Command add_evaluate(CLI::App& app, const Common&) {
  struct Arguments {
    std::string model, run, empty, range_bias_action = "warn";
    std::vector<std::string> train;
    std::string output = "own";
    bool all = false, json = false;
  };
  const auto a = std::make_shared<Arguments>();
  app.add_option("model", a->model, "model file")->required();
  app.add_option("run", a->run, "run file")->required();
  app.add_flag("--all", a->all, "also score records that the model was trained on");
  app.add_option("--train", a->train,
                 "the runs the model was trained on, for the nearest-neighbour row of a fresh run");
  add_empty_option(app, a->empty);
  add_range_bias_option(app, a->range_bias_action);
  add_output_option(app, a->output);
  app.add_flag("--json", a->json, "one JSON object instead of text");
  return [a] {
    const TrainedModel model = model_for_room(a->model, a->empty);
    Dataset data = load_recorded({a->run}), other;
    const Records records =
        prepare_records(model, data, range_bias_action_of(a->range_bias_action));
    subtract_range_offset(data, 0);
    if (!a->train.empty()) {
      other = load(a->train);
      require_map(other, model.scene.grid, "the model");
      if (!model.knows(other))
        throw Error(ExitCode::failed, a->train.front() + ": " + a->model +
                                          " was not trained on it; give the training run, or "
                                          "leave --train out");
    }
    const Dataset& trained_on = a->train.empty() ? data : other;
    const Rows rows = rows_to_evaluate(model, records.data, a->all);
    Evaluation e = evaluate(model, records, rows, a->output);
    e.baselines = score_baselines(data, rows, model.scene, trained_on,
                                  model.rows_of(trained_on, Part::train));
    set_threads(1);
    e.cost = measure_cost(model, records.data, rows, a->model);
    std::puts(a->json
                  ? to_json(e).dump(2, ' ', true, nlohmann::json::error_handler_t::replace).c_str()
                  : printable_lines(to_text(e)).c_str());
    return ExitCode::ok;
  };
}

Command add_reconstruct(CLI::App& app, const Common& common) {
  struct Arguments : ReconstructOptions {
    std::string model, run, empty, range_bias_action = "warn";
  };
  const auto a = std::make_shared<Arguments>();
  app.add_option("model", a->model, "model file")->required();
  app.add_option("run", a->run, "run file")->required();
  app.add_option("--out", a->out, "folder for the maps")->required();
  app.add_option("--format", a->formats, "any of " + map_format_help())
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::IsMember(map_format_names()))
      ->capture_default_str();
  add_empty_option(app, a->empty);
  add_range_bias_option(app, a->range_bias_action);
  add_output_option(app, a->output);
  app.add_option("--zoom", a->zoom_m,
                 "not the whole map but a window of so many metres, both ways, about its body")
      ->check(CLI::Range(0.1, 20.0));
  app.add_flag("--follow", a->follow,
               "of a run that is being recorded: new records as they come, until it is closed");
  app.add_flag("--force", a->force, "write into a folder that holds maps of another run");
  const auto part = add_part_option(app);
  return [a, part, &common] {
    a->quiet = common.quiet;
    a->part = part_of(*part);
    ReconstructReport talk(a->run, a->follow, common.quiet);
    a->on_record = [&](const RecordStatus& r) { talk.add(r); };
    a->range_bias = range_bias_action_of(a->range_bias_action);
    a->on_run = [&](const std::string& text) {
      std::fprintf(stderr, "%s: %s\n", printable(a->run).c_str(), printable(text).c_str());
    };
    const TrainedModel model = model_for_room(a->model, a->empty);
    a->files = {a->model};
    if (!a->empty.empty()) a->files.push_back(a->empty);
    reconstruct(model, a->run, *a);
    if (!model.uncertainty && !common.quiet)
      std::fprintf(stderr, "%s: %s: too few training records to say how far off the maps are\n",
                   printable(a->model).c_str(), calibration_of(model));
    talk.finish(a->out);
    if (interrupted()) return ExitCode::interrupted;
    return talk.all_well() ? ExitCode::ok : ExitCode::partial;
  };
}

Command add_crossvalidate(CLI::App& app, const Common& common) {
  struct Arguments : CrossvalidateOptions {
    std::vector<std::string> runs;
    std::string published, out;
  };
  const auto a = std::make_shared<Arguments>();
  app.add_option("run", a->runs, "run files whose axes agree, in the order of time")->required();
  app.add_option("--models", a->models)
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(is_candidate)
      ->capture_default_str();
  app.add_option("--folds", a->folds)->check(CLI::Range(2, 1000))->capture_default_str();
  app.add_option("--gap", a->gap, "records between a fold and its training records")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
  app.add_option("--published", a->published,
                 "a run whose depth maps are another's reconstructions of the same records");
  add_inputs_option(app, a->inputs);
  add_fit_options(app, a->scaling, a->fit);
  app.add_option("--seed", a->fit.seed, "of weights and order")->capture_default_str();
  app.add_option("--out", a->out, "folder for study.sqlite, which keeps what is measured");
  const auto part = add_part_option(app);
  return [a, part, &common] {
    a->fit.quiet = common.quiet, a->letters = true;
    const auto which = part_of(*part);
    if (which && a->out.empty())
      throw Error(ExitCode::usage, "--part: name the folder of the parts with --out");
    const Dataset data = load(a->runs);
    std::unique_ptr<FoldFile> file;
    if (!a->out.empty()) {
      StudyOptions options;
      options.out = a->out, options.part = which;
      const StudySettings settings =
          fold_settings(data, a->scaling, a->fit,
                        {{"gap", std::to_string(a->gap)}, {"of", std::to_string(a->folds)}});
      file = std::make_unique<FoldFile>(options, settings, a->inputs, a->models, a->folds);
      a->shared = &file->shared();
    }
    const auto rows =
        crossvalidate(data, rows_to_train(data, inputs_of(a->inputs)), *a,
                      which || a->published.empty() ? Dataset{} : load({a->published}));
    if (file) file->finish();
    if (which) return all_fitted(rows) ? ExitCode::ok : ExitCode::partial;
    std::printf("%zu folds, gap %zu; mean over maps +- standard error over folds\n%s%s", a->folds,
                a->gap, to_table({rows.begin(), rows.end()}).c_str(),
                to_span_table({rows.begin(), rows.end()}).c_str());
    return all_fitted(rows) ? ExitCode::ok : ExitCode::partial;
  };
}

Command add_report(CLI::App& app, const Common&) {
  const auto a = std::make_shared<ReportOptions>();
  app.add_option("dir", a->dir, "folder for report.html and its pictures")->required();
  app.add_option("--run", a->run, "run file; its held-out records are scored");
  app.add_option("--fused", a->fused, "model file of both sensors; several are seeds of one");
  app.add_option("--spd", a->spd, "model file, for a row below; several are seeds of one");
  app.add_option("--radar", a->radar, "model file, for a row below; several are seeds of one");
  app.add_option("--paper", a->paper,
                 "model file: the paper's network on both sensors, for a row below the fused one");
  app.add_option("--compare", a->compare, "two model files: their differences record by record")
      ->expected(2);
  app.add_option("--live", a->live,
                 "a recorded run: its story, also without any model; with --fused also its maps");
  add_empty_option(app, a->empty);
  app.add_flag("--force", a->force, "write over a report of another run");
  return [a] {
    a->command = command_line();
    check_report(*a);
    set_threads(1);  // the latencies in the table are those of one thread
    const Report report = make_report(*a);
    std::printf("%s%s\n", printable_lines(to_text(report)).c_str(),
                printable(write_report(report, a->dir)).c_str());
    return ExitCode::ok;
  };
}

Command add_export(CLI::App& app, const Common& common) {
  struct Arguments {
    std::string model, to;
    std::vector<std::string> runs;
  };
  const auto a = std::make_shared<Arguments>();
  app.add_option("model", a->model, "model file")->required();
  app.add_option("--to", a->to, "x.onnx: the network; x.npz: the records of --run as it sees them")
      ->required();
  app.add_option("--run", a->runs, "run files, for x.npz");
  return [a, &common] {
    export_model(a->model, a->runs, a->to);
    if (!common.quiet) std::fprintf(stderr, "%s: written\n", a->to.c_str());
    return ExitCode::ok;
  };
}

Command add_import(CLI::App& app, const Common& common) {
  struct Arguments {
    std::string source, dir, out, published;
  };
  const auto a = std::make_shared<Arguments>();
  app.add_option("source", a->source, "turpin: histogram.npy, depth.npy, published.npy")
      ->required()
      ->check(CLI::IsMember({"turpin"}));
  app.add_option("dir", a->dir, "folder with the arrays")->required();
  app.add_option("--out", a->out, "run file to make (never overwritten)")->required();
  app.add_option(
      "--published", a->published,
      "second run file to make: the same frames with the published reconstruction as depth");
  return [a, &common] {
    const auto frames = import_turpin(a->dir, a->out, a->published);
    if (!common.quiet)
      std::fprintf(stderr, "%s: %lld frames; depth 1.0 (the scene's maximum) is stored as %.0f m\n",
                   a->out.c_str(), static_cast<long long>(frames), turpin_scale_m);
    return ExitCode::ok;
  };
}

}  // namespace echofuse::recon

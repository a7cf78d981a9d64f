// SPDX-License-Identifier: MIT
#include "recon/study/transfer.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "drivers/core/console.hpp"
#include "drivers/core/program.hpp"
#include "recon/estimator/train.hpp"
#include "recon/files/text.hpp"
#include "recon/study/simulate.hpp"

namespace echofuse::recon {
namespace {

const std::vector<std::size_t> all_sizes = {10, 20, 50, 100, 200, 500, 1000},
                               quick_sizes = {10, 50, 200};
constexpr std::uint64_t seed_of_b = 5000;
const std::vector<std::string> worlds_a = {"base", "twin"};

Dataset cut(const Dataset& data, std::size_t first, std::size_t count) {
  Rows rows;
  for (std::size_t i = 0; i < count; ++i) rows.push_back(first + i);
  return part_of_run(data, rows);
}

template <class T>
void append(std::vector<T>& to, const std::vector<T>& more) {
  to.insert(to.end(), more.begin(), more.end());
}

// Of the same axes.
Dataset joined(Dataset a, const Dataset& b) {
  Source source = b.sources.front();
  source.first = a.size();
  append_rows(a.spd, b.spd), append_rows(a.radar, b.radar);
  append_rows(a.depth, b.depth), append_rows(a.array, b.array);
  append(a.valid, b.valid), append(a.index, b.index), append(a.slot_end, b.slot_end);
  append(a.speckle, b.speckle), append(a.clicks_a_pulse, b.clicks_a_pulse);
  append(a.label, b.label);
  a.sources.push_back(source);
  return a;
}

struct Job {
  std::string from, model;
  std::size_t records;
};

std::vector<Job> jobs_of(const TransferOptions& o) {
  std::vector<Job> out;
  for (const std::string& from : worlds_a) out.push_back({from, "as it was", 0});
  for (const char* constant : {"empty room", "mean map", "nearest neighbour"})
    out.push_back({"none", constant, o.sizes.back()});
  for (const std::size_t records : o.sizes) {
    if (records >= TuneOptions::least_alone) out.push_back({"none", "alone", records});
    for (const std::string& from : worlds_a) {
      out.push_back({from, "pooled", records});
      if (!o.quick) out.push_back({from, "pooled weighted", records});
      out.push_back({from, "tuned", records});
      if (o.quick) continue;
      for (const std::string& choice : choice_names())
        if (choice.starts_with("tuned ") &&
            (records >= TuneOptions::least_alone || !choice.starts_with("tuned and turned")))
          out.push_back({from, choice, records});
    }
  }
  return out;
}

class Study {
 public:
  explicit Study(const TransferOptions& options)
      : options_(options),
        jobs_(jobs_of(options)),
        file_(options, settings(), ExitCode::config),
        simulator_(options.sim, options.out, options.threads),
        progress_("study", jobs_.size() * options.seeds, options.quiet) {}

  std::vector<Measurement> run() {
    const std::vector<bool> mine = my_rows();
    std::size_t row = 0;
    for (std::size_t i = 0; i < options_.seeds; ++i) {
      seed_ = options_.first_seed + i;
      of_a_.clear(), models_.clear(), b_.reset();
      for (const Job& job : jobs_) {
        Measurement m{job.from, std::to_string(job.records), job.model, "fused", seed_};
        const bool known = file_.has(m);
        if (known) file_.keep(m);
        if (mine[row++] && !known) {
          measure(job, m);
          if (!options_.part && m.metrics.contains("train_s")) m.machine = machine_name();
          if (options_.part) m.metrics.erase("train_s");
          file_.add({&m, 1});
        }
        progress_.update(++done_, job.model);
      }
    }
    file_.finish();
    return options_.part ? std::vector<Measurement>{} : file_.all();
  }

 private:
  // What one process measures: all that comes from one model of one world A, which is then trained
  // once; each other training by itself.
  std::vector<bool> my_rows() const {
    std::vector<RowOfWork> rows;
    for (std::size_t i = 0; i < options_.seeds; ++i)
      for (const Job& job : jobs_) {
        const bool pooled = job.model.starts_with("pooled"), alone = job.model == "alone";
        const bool constant = job.from == "none" && !alone;
        rows.push_back(
            {(constant ? worlds_a.front() : job.from) + "/" + std::to_string(i) +
                 (pooled || alone ? "/" + job.model + "/" + std::to_string(job.records) : ""),
             pooled || job.model == "as it was" ? 5. : 1.});
      }
    return share_of(options_.part, rows);
  }

  StudySettings settings() const {
    return {{"study", "transfer"},
            {"echofuse", version()},
            {"twin", options_.twin},
            {"model", options_.model},
            {"records", std::to_string(options_.records)},
            {"test_records", std::to_string(options_.test_records)}};
  }

  const Dataset& of_a(const std::string& from) {
    if (!of_a_.contains(from)) {
      std::vector<std::string> words;
      if (from == "twin")
        words = {"--twin", options_.twin, "--laboratories", std::to_string(laboratories_of_a)};
      of_a_.emplace(from, simulator_.make_with(words, options_.records, seed_));
    }
    return of_a_.at(from);
  }
  // First the records to judge by, then those to tune with: more of these change no other.
  const Dataset& of_b() {
    if (!b_)
      b_ = simulator_.make_with(
          {"--twin", options_.twin, "--laboratory", std::to_string(first_b + seed_)},
          options_.test_records + options_.sizes.back(), seed_of_b + seed_);
    return *b_;
  }
  const TrainedModel& trained(const std::string& from) {
    if (!models_.contains(from)) models_.emplace(from, train_fully(of_a(from), {}));
    return models_.at(from);
  }
  TrainedModel train_fully(const Dataset& data, const std::vector<double>& weights) const {
    TrainOptions how;
    how.model = options_.model, how.inputs = "fused";
    how.split.test_share = 0;
    how.split.seed = how.fit.seed = seed_;
    how.fit.quiet = true;
    how.weights = weights;
    how.validate_on = {data.sources.size() - 1};
    return train(data, how);
  }

  TrainedModel tuned(const Job& job) {
    TuneOptions how;
    how.split.test_share = how.split.validation_share = 0;
    how.split.seed = how.tuning.seed = seed_;
    if (job.model != "tuned") how.only = job.model;
    const TrainedModel& from = trained(job.from);
    Dataset data = cut(of_b(), options_.test_records, job.records);
    match_for_tuning(from, "the model", data);
    return tune(from, data, how).model;
  }

  TrainedModel pooled(const Job& job) {
    const Dataset& a = of_a(job.from);
    const auto times = static_cast<double>(a.size()) / static_cast<double>(job.records);
    return train_fully(joined(a, cut(of_b(), options_.test_records, job.records)),
                       job.model == "pooled" ? std::vector<double>{}
                                             : std::vector<double>{1, std::max(1., times / 2)});
  }

  void judge(const TrainedModel& model, Measurement& m) {
    const Records records =
        prepare_records(model, cut(of_b(), 0, options_.test_records), RangeBiasAction::ignore);
    const Evaluation e = evaluate(model, records, rows_to_evaluate(model, records.data, true));
    for (const Metric metric : transfer_metrics)
      m.metrics[metric_names[metric]] = e.metrics[metric].mean;
    if (e.calibration) m.metrics["within_90"] = e.calibration->within_90;
    m.metrics["train_s"] = model.train_s;
  }

  void measure(const Job& job, Measurement& m) {
    if (job.model == "as it was") return judge(trained(job.from), m);
    if (job.model == "alone")
      return judge(train_fully(cut(of_b(), options_.test_records, job.records), {}), m);
    if (job.model.starts_with("pooled")) return judge(pooled(job), m);
    if (job.model.starts_with("tuned")) return judge(tuned(job), m);
    const Dataset test = cut(of_b(), 0, options_.test_records);
    const Dataset known = cut(of_b(), options_.test_records, job.records);
    const Rows rows = test.usable(Inputs::fused), neighbours = known.usable(Inputs::fused);
    const Scene scene = learn_scene(known.depth, neighbours, known.map);
    const auto baselines = score_baselines(test, rows, scene, known, neighbours);
    const ScoredRow& row = baselines.at(job.model == "empty room" ? 0
                                        : job.model == "mean map" ? 1
                                                                  : 2);
    for (const Metric metric : transfer_metrics)
      m.metrics[metric_names[metric]] = row.metrics[metric].mean;
  }

  const TransferOptions& options_;
  std::vector<Job> jobs_;
  StudyFile file_;
  Simulator simulator_;
  Progress progress_;
  std::size_t done_ = 0, seed_ = 0;
  std::map<std::string, Dataset> of_a_;
  std::map<std::string, TrainedModel> models_;
  std::optional<Dataset> b_;
};

}  // namespace

TransferOptions complete(TransferOptions o) {
  if (o.sizes.empty()) o.sizes = o.quick ? quick_sizes : all_sizes;
  std::sort(o.sizes.begin(), o.sizes.end());
  if (o.records == 0) o.records = o.quick ? 2000 : 4000;
  if (o.test_records == 0) o.test_records = o.quick ? 300 : 1000;
  const Candidate candidate = candidate_of(o.model, {});
  if (!wants_alignment(candidate.model) && kind_of(candidate.model).size != ModelKind::Size::hidden)
    throw Error(ExitCode::usage, "--model " + o.model + ": cannot be tuned");
  return o;
}

std::vector<Measurement> study_transfer(const TransferOptions& options) {
  return Study(options).run();
}

}  // namespace echofuse::recon

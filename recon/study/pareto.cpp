// SPDX-License-Identifier: MIT
#include "recon/study/pareto.hpp"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "drivers/core/random.hpp"
#include "drivers/program/console.hpp"
#include "drivers/program/exit_code.hpp"
#include "drivers/program/new_file.hpp"
#include "drivers/program/program.hpp"
#include "recon/data/files.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/numbers/text.hpp"
#include "recon/study/study_file.hpp"

namespace echofuse::recon {
namespace {

struct Job {
  std::string sweep, share;
  StudyModel model;
  Measurement row(std::size_t seed) const {
    return {sweep, share, model.candidate, model.inputs, seed};
  }
};

ParetoOptions of_run(ParetoOptions options, const Dataset& train) {
  if (train.array_axis.count > 0) options.models = with_profiles(options.models);
  return options;
}

std::vector<Job> jobs_of(const ParetoOptions& options) {
  std::vector<Job> jobs;
  const auto add = [&](const char* sweep, double share, const std::string& model) {
    jobs.push_back({sweep, formatted("%g", share), StudyModel(model)});
  };
  for (const auto& model : options.models) add("model", 1, model);
  for (const auto& model : options.sweep_models) {
    for (const double share : options.photons) add("photons", share, model);
    for (const double share : options.records) add("records", share, model);
  }
  return jobs;
}

// A shorter exposure: each photon is kept with this chance. (A calibrated run's histograms are
// interpolated: their counts are rounded.)
void thin(Dataset& data, double share, std::uint64_t seed) {
  Rng rng = make_rng(seed, 0);
  for (float& count : data.spd.values) {
    std::binomial_distribution<std::uint32_t> kept(
        static_cast<std::uint32_t>(std::lround(std::max(count, 0.f))), share);
    count = static_cast<float>(kept(rng));
  }
}

void keep_records(Dataset& data, double share, std::uint64_t seed) {
  Rows rows = all_rows(data.size());
  Rng rng = make_rng(seed, 1);
  std::shuffle(rows.begin(), rows.end(), rng);
  const auto keep = static_cast<std::size_t>(std::ceil(share * static_cast<double>(data.size())));
  for (std::size_t i = keep; i < rows.size(); ++i) data.valid[rows[i]] = 0;
}

void mark_front(std::vector<ParetoRow>& rows) {
  for (auto& row : rows)
    row.front = row.sweep == "model" && row.timed &&
                std::none_of(rows.begin(), rows.end(), [&](const ParetoRow& other) {
                  return other.sweep == "model" && other.infer_us_median < row.infer_us_median &&
                         other.mean[metric_iou] >= row.mean[metric_iou];
                });
}

// In the order of the jobs.
std::vector<ParetoRow> rows_of(const std::vector<Job>& jobs, const std::vector<Measurement>& all) {
  std::vector<ParetoRow> rows;
  for (const Job& job : jobs) {
    ParetoRow row{job.sweep, job.share, job.model.name};
    std::vector<MapScores> found;
    for (const Measurement& m : all) {
      if (m.key() != job.row(m.seed).key()) continue;
      MapScores& scores = found.emplace_back();
      for (std::size_t i = 0; i < metric_count; ++i) scores[i] = m.metric(metric_names[i]);
      row.multiply_adds = m.metric("multiply_adds");
      if (m.machine == no_machine) continue;
      row.timed = true;
      row.infer_us_median = m.metric("infer_us_median");
      row.infer_us_p99 = m.metric("infer_us_p99");
      row.train_s = m.metric("train_s");
    }
    const Summaries over_seeds = summarise(found);
    row.seeds = found.size();
    for (std::size_t i = 0; i < metric_count; ++i) {
      row.mean[i] = over_seeds[i].mean;
      row.spread[i] = over_seeds[i].se * std::sqrt(static_cast<double>(over_seeds[i].maps));
    }
    rows.push_back(row);
  }
  mark_front(rows);
  return rows;
}

class Study {
 public:
  explicit Study(const ParetoOptions& options)
      : train_(load({options.train})),
        test_(load({options.test})),
        options_(of_run(options, train_)),
        jobs_(jobs_of(options_)),
        progress_("study", jobs_.size() * options.seeds, options.quiet) {
    for (const Source& run : test_.sources)
      if (run.uuid == train_.sources.front().uuid)
        throw Error(ExitCode::usage,
                    run.path + ": the models are trained on this run; judge them by another");
    if (const std::size_t copies = leave_out_copies(test_, train_); copies > 0)
      std::fprintf(stderr, "%s: %zu of %zu records are copies of training records: left out\n",
                   options.test.c_str(), copies, test_.size());
    match_axes(test_, train_.spd_axis, train_.radar_axis, Inputs::fused);
    match_array(test_, train_.array_axis);
    for (const Job& job : jobs_) {
      TrainedModel judged;
      judged.estimators.resize(1);
      judged->features.inputs = inputs_of(job.model.inputs);
      rows_to_evaluate(judged, test_, true);  // are there any?
    }
  }

  std::vector<ParetoRow> run() {
    std::vector<std::string> columns(metric_names.begin(), metric_names.end());
    for (const char* cost : {"multiply_adds", "infer_us_median", "infer_us_p99", "train_s"})
      columns.emplace_back(cost);
    StudyFile file(options_, settings(), columns, ExitCode::usage);
    const std::vector<bool> mine = my_rows();
    std::size_t row = 0;
    for (const Job& job : jobs_)
      for (std::size_t seed = 1; seed <= options_.seeds; ++seed, ++row) {
        if (!file.take(job.row(seed), seed == options_.seeds && !options_.part) && mine[row])
          file.add(measure(job, seed));
        progress_.update(row + 1, job.model.name);
      }
    return options_.part ? std::vector<ParetoRow>{} : rows_of(jobs_, file.all());
  }

 private:
  StudySettings settings() const {
    const auto run = [](const Dataset& data) {
      return data.sources.front().uuid + formatted(" (checksum %08x)", data.hash);
    };
    return {
        {"study", "pareto"}, {"echofuse", version()}, {"train", run(train_)}, {"test", run(test_)}};
  }

  // Times of one machine can be compared: if there are parts, the run that takes them trains all
  // models once, with the last seed.
  std::vector<bool> my_rows() const {
    if (!options_.part) return std::vector<bool>(jobs_.size() * options_.seeds, true);
    if (options_.seeds < 2)
      throw Error(ExitCode::usage,
                  "--part with --seeds 1: nothing to share; the run that takes the parts measures "
                  "the times, and trains each model with the last seed for that");
    std::vector<double> work;
    for (const Job& job : jobs_) {
      work.insert(work.end(), options_.seeds, is_network(job.model) ? 5 : 1);
      work.back() = 0;
    }
    std::vector<bool> out = options_.part->share(work);
    for (std::size_t row = 0; row < out.size(); ++row) out[row] = out[row] && work[row] > 0;
    return out;
  }

  Measurement measure(const Job& job, std::size_t seed) const {
    Measurement m = job.row(seed);
    Dataset train_data = train_, test_data = test_;
    const double share = std::stod(job.share);
    if (job.sweep == "photons") thin(train_data, share, seed);
    if (job.sweep == "photons") thin(test_data, share, 1000 + seed);
    if (job.sweep == "records") keep_records(train_data, share, seed);
    const TrainedModel model = train_on_all(train_data, job.model, seed);
    const Rows rows = test_data.usable(model->features.inputs);
    const MapScores scores =
        mean_scores(model.predict(test_data, rows), test_data, rows, judge_.scene);
    for (std::size_t i = 0; i < metric_count; ++i) m.metrics[metric_names[i]] = scores[i];
    m.metrics["multiply_adds"] = static_cast<double>(model->cost().multiply_adds);
    if (!options_.part) measure_times(model, test_data, rows, m);
    return m;
  }

  void measure_times(const TrainedModel& model, const Dataset& test_data, const Rows& rows,
                     Measurement& m) const {
    const TemporaryFile file{scratch_folder(options_.out) + "/.study-" + machine_name() + "-" +
                             std::to_string(::getpid()) + ".h5"};
    save_model(model, file.path);
    set_threads(1);
    const RunningCost cost = measure_cost(model, test_data, rows, file.path);
    set_threads(options_.threads);
    m.machine = machine_name();
    m.metrics["infer_us_median"] = cost.infer_us_median;
    m.metrics["infer_us_p99"] = cost.infer_us_p99;
    m.metrics["train_s"] = cost.train_s;
  }

  Dataset train_, test_;
  const Judge judge_ = judge_of(train_);
  const ParetoOptions options_;
  const std::vector<Job> jobs_;
  Progress progress_;
};

}  // namespace

std::vector<ParetoRow> study_pareto(const ParetoOptions& options) {
  jobs_of(options);  // are they all known?
  return Study(options).run();
}

}  // namespace echofuse::recon

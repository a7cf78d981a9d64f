// SPDX-License-Identifier: MIT
#include "recon/study/pareto.hpp"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <random>

#include "drivers/core/console.hpp"
#include "drivers/core/exit_code.hpp"
#include "drivers/core/random.hpp"
#include "recon/files/files.hpp"
#include "recon/files/text.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/study/study.hpp"

namespace echofuse::recon {
namespace {

struct Job {
  Job(std::string what, double how_much, const std::string& name)
      : sweep(std::move(what)), share(how_much), model(name) {}
  std::string sweep;
  double share;
  StudyModel model;
};

std::vector<Job> jobs_of(const ParetoOptions& options) {
  std::vector<Job> jobs;
  for (const auto& model : options.models) jobs.emplace_back("model", 1, model);
  for (const auto& model : options.sweep_models) {
    for (const double share : options.photons) jobs.emplace_back("photons", share, model);
    for (const double share : options.records) jobs.emplace_back("records", share, model);
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

class Study {
 public:
  explicit Study(const ParetoOptions& options)
      : options_(options),
        train_(load({options.train})),
        test_(load({options.test})),
        progress_("study", jobs_of(options).size() * options.seeds, options.quiet) {
    for (const Source& run : test_.sources)
      if (run.uuid == train_.sources.front().uuid)
        throw Error(ExitCode::usage,
                    run.path + ": the models are trained on this run; judge them by another");
    match_axes(test_, train_.spd_axis, train_.radar_axis, Inputs::fused);
    for (const Job& job : jobs_of(options)) {
      TrainedModel judged;
      judged.features.inputs = inputs_of(job.model.inputs);
      rows_to_evaluate(judged, test_, true);  // are there any?
    }
    take_folder();
  }

  std::vector<ParetoRow> run() {
    std::vector<ParetoRow> rows = read_pareto(options_.out);
    for (const Job& job : jobs_of(options_)) {
      const auto known =
          std::find_if(rows.begin(), rows.end(), [&](const ParetoRow& r) { return is_of(r, job); });
      if (known != rows.end() && known->seeds == options_.seeds) {
        progress_.update(done_ += options_.seeds, job.model.name);
        continue;
      }
      if (known != rows.end()) rows.erase(known);
      rows.push_back(measure(job));
      mark_front(rows);
      write_pareto_table(rows, options_.out);
    }
    return rows;
  }

 private:
  // Rows of other runs, or of another version, must not mix with these.
  void take_folder() const {
    std::string runs = std::string("echofuse ") + version() + "\n";
    for (const Dataset* data : {&train_, &test_})
      runs += data->sources.front().uuid + formatted(" (checksum %08x)\n", data->hash);
    const std::string path = options_.out + "/pareto.runs";
    if (std::filesystem::exists(path)) {
      if (read_text(path) == runs) return;
      throw Error(ExitCode::usage, options_.out +
                                       ": holds a study of other runs, or of another version of "
                                       "echofuse; give another --out");
    }
    if (std::filesystem::exists(options_.out + "/pareto.csv"))
      throw Error(ExitCode::usage, options_.out +
                                       ": holds a pareto.csv of unknown runs (no pareto.runs); "
                                       "give another --out");
    write_text(path, runs);
  }

  // The table keeps six digits of a share.
  static bool is_of(const ParetoRow& row, const Job& job) {
    return row.sweep == job.sweep && row.model == job.model.name &&
           std::abs(row.share - job.share) < 1e-5 * job.share;
  }

  ParetoRow measure(const Job& job) {
    ParetoRow row{job.sweep, job.share, job.model.name, options_.seeds, {}, {}, {}, false};
    std::vector<MapScores> found;
    for (std::size_t seed = 1; seed <= options_.seeds; ++seed) {
      found.push_back(once(job, seed, row.cost));
      if (interrupted())  // what was cut short is not kept
        throw Error(ExitCode::interrupted, "interrupted; the same command goes on");
      progress_.update(++done_, job.model.name);
    }
    const Summaries over_seeds = summarise(found);
    for (std::size_t m = 0; m < metric_count; ++m) {
      row.mean[m] = over_seeds[m].mean;
      row.spread[m] = over_seeds[m].se * std::sqrt(static_cast<double>(over_seeds[m].maps));
    }
    return row;
  }

  MapScores once(const Job& job, std::size_t seed, RunningCost& cost) {
    Dataset train_data = train_, test_data = test_;
    if (job.sweep == "photons") thin(train_data, job.share, seed);
    if (job.sweep == "photons") thin(test_data, job.share, 1000 + seed);
    if (job.sweep == "records") keep_records(train_data, job.share, seed);
    const TrainedModel model = train_on_all(train_data, job.model, seed);
    const Rows rows = test_data.usable(model.features.inputs);
    const MapScores out = mean_scores(model.predict(test_data, rows), test_data, rows, model.scene);
    const TemporaryFile file{options_.out + "/.study-" + std::to_string(::getpid()) + ".h5"};
    save_model(model, file.path);
    set_threads(1);
    cost = measure_cost(model, test_data, rows, file.path);
    set_threads(options_.threads);
    return out;
  }

  static void mark_front(std::vector<ParetoRow>& rows) {
    for (auto& row : rows)
      row.front = row.sweep == "model" &&
                  std::none_of(rows.begin(), rows.end(), [&](const ParetoRow& other) {
                    return other.sweep == "model" &&
                           other.cost.infer_us_median < row.cost.infer_us_median &&
                           other.mean[metric_iou] >= row.mean[metric_iou];
                  });
  }

  const ParetoOptions& options_;
  Dataset train_, test_;
  Progress progress_;
  std::size_t done_ = 0;
};

}  // namespace

std::vector<ParetoRow> study_pareto(const ParetoOptions& options) {
  jobs_of(options);  // are they all known?
  make_folder(options.out);
  return Study(options).run();
}

}  // namespace echofuse::recon

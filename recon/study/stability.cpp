// SPDX-License-Identifier: MIT
#include "recon/study/stability.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <optional>
#include <set>

#include "drivers/program/console.hpp"
#include "drivers/program/printable.hpp"
#include "recon/study/simulate.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t test_seeds = 1000;  // the test records' seed, after the training records'

// One value of one axis; the base value of all of them is measured once.
struct Place {
  std::string axis, value;
  World train, test;
};

std::vector<Place> places_of(const StabilityOptions& options) {
  std::vector<Place> places = {{"base", "base", {}, {}}};
  for (const StabilityAxis& axis : axes_of(options))
    for (const AxisValue& v : axis.values)
      if (!v.world.base())
        places.push_back({axis.id(), v.label, axis.matched ? v.world : World{}, v.world});
  return places;
}

bool is_shifted(const Place& place) { return place.axis.starts_with("shifted"); }
bool is_matched(const Place& place) { return place.axis.starts_with("matched"); }

// Trainings take most of the time, those of a network most of that.
std::size_t work_of(const Place& place, const StudyModel& model) {
  if (is_shifted(place) || ignores_inputs(model.name)) return 1;
  const double records = std::max(1., place.train.records);  // a factor
  return static_cast<std::size_t>(std::lround((is_network(model) ? 20 : 4) * records));
}

class Study {
 public:
  explicit Study(const StabilityOptions& options)
      : options_(options),
        places_(places_of(options)),
        file_(options, settings(), columns(), ExitCode::config),
        simulator_(options.sim, options.out, options.threads, options.set),
        progress_("study", work(), options.quiet) {}

  std::vector<Measurement> run() {
    std::size_t first = 0;  // row of a place
    for (std::size_t i = 0; i < options_.seeds; ++i) {
      trained_.clear(), train_data_.reset(), test_data_.reset();
      for (const Place& place : places_) {
        measure(place, 1 + i, first);
        first += models_.size();
      }
    }
    return options_.part ? std::vector<Measurement>{} : file_.all();
  }

 private:
  static std::vector<StudyModel> models_of(const StabilityOptions& options) {
    std::vector<StudyModel> models(constant_models.begin(), constant_models.end());
    for (const auto& name : options.models) models.emplace_back(name);
    return models;
  }

  StudySettings settings() const {
    return {{"study", "stability"},
            {"echofuse", version()},
            {"quick", options_.quick ? "yes" : "no"},
            {"records", std::to_string(options_.records)},
            {"test-records", std::to_string(options_.test_records)},
            {"set", joined(options_.set, " ")}};
  }

  static std::vector<std::string> columns() {
    std::vector<std::string> out;
    for (const Metric m : stability_metrics) out.emplace_back(metric_names[m]);
    return out;
  }

  static Measurement row_of(const Place& place, const StudyModel& model, std::size_t seed) {
    return {place.axis, place.value, model.candidate,
            ignores_inputs(model.candidate) ? "-" : model.inputs, seed};
  }

  // This is what one process measures: a model and a seed with all shifted conditions, so that the
  // model of the base condition is trained once; of matched ones each by itself. The constant
  // models, for which alone nobody should make records, go with the first other one.
  std::vector<bool> my_rows() const {
    std::map<std::string, std::size_t> numbers;  // of the pieces, in the order of their first rows
    std::vector<std::size_t> piece_of;           // the rows
    std::vector<double> work;                    // of the pieces
    for (std::size_t i = 0; i < options_.seeds; ++i)
      for (const Place& place : places_)
        for (std::size_t m = 0; m < models_.size(); ++m) {
          const std::size_t model =
              std::min(std::max(m, constant_models.size()), models_.size() - 1);
          std::string name = models_[model].name + "/" + std::to_string(i);
          if (is_matched(place)) name += "/" + place.axis + "/" + place.value;
          piece_of.push_back(numbers.emplace(name, numbers.size()).first->second);
          work.resize(numbers.size());
          work[piece_of.back()] += static_cast<double>(work_of(place, models_[m]));
        }
    const std::vector<bool> mine =
        options_.part ? options_.part->share(work) : std::vector<bool>(work.size(), true);
    std::vector<bool> out;
    for (const std::size_t piece : piece_of) out.push_back(mine[piece]);
    return out;
  }

  std::size_t work() {
    std::size_t sum = 0, row = 0;
    for (std::size_t i = 0; i < options_.seeds; ++i)
      for (const Place& place : places_)
        for (const StudyModel& model : models_)
          if (mine_[row++] && !file_.has(row_of(place, model, 1 + i))) sum += work_of(place, model);
    return sum;
  }

  void measure(const Place& place, std::size_t seed, std::size_t at) {
    std::optional<Dataset> train_data, test_data;
    for (const StudyModel& model : models_) {
      Measurement row = row_of(place, model, seed);
      const bool mine = mine_[at++];
      if (file_.take(row) || !mine) continue;
      if (!test_data) test_data = test_records(place.test, seed);
      const bool own = is_matched(place);
      if (own && !train_data) train_data = training_records(place.train, seed);
      const std::optional<TrainedModel> fitted =
          own ? fit(*train_data, model, seed, false) : std::optional<TrainedModel>{};
      row.metrics = judge(own ? fitted : base_model(model, seed), *test_data, model);
      file_.add(row);
      progress_.update(done_ += work_of(place, model),
                       place.axis + " " + place.value + ": " + model.name);
    }
  }

  Dataset training_records(const World& world, std::size_t seed) const {
    const double records = std::round(world.records * static_cast<double>(options_.records));
    return simulator_.make(world, static_cast<std::size_t>(records), seed);
  }

  Dataset test_records(const World& world, std::size_t seed) {
    if (!world.measured_at_base())
      return simulator_.make(world, options_.test_records, test_seeds + seed);
    if (!test_data_) test_data_ = simulator_.make({}, options_.test_records, test_seeds + seed);
    Dataset copy = *test_data_;
    apply(world, copy);
    return copy;
  }

  // Nothing if the training is refused or diverges; each reason is said once.
  std::optional<TrainedModel> fit(const Dataset& data, const StudyModel& model, std::size_t seed,
                                  bool at_base) {
    try {
      return train_on_all(data, model, seed, at_base);
    } catch (const Error& error) {
      if (error.code() != ExitCode::failed) throw;
      const std::string reason = model.name + ": " + error.what();
      if (reasons_.insert(reason).second) std::fprintf(stderr, "%s\n", printable(reason).c_str());
      return {};
    }
  }

  // Models of the base condition are trained once a seed.
  const std::optional<TrainedModel>& base_model(const StudyModel& model, std::size_t seed) {
    const auto found = trained_.find(model.name);
    if (found != trained_.end()) return found->second;
    if (!train_data_) train_data_ = training_records({}, seed);
    return trained_.emplace(model.name, fit(*train_data_, model, seed, true)).first->second;
  }

  std::map<std::string, double> judge(const std::optional<TrainedModel>& fitted,
                                      const Dataset& tested, const StudyModel& model) const {
    std::map<std::string, double> out;
    for (const Metric m : stability_metrics)
      out[metric_names[m]] = std::numeric_limits<double>::quiet_NaN();
    if (!fitted) return out;
    const Records records = prepare_records(*fitted, tested);
    const Dataset& data = records.data;
    Rows rows = all_rows(data.size());
    if (!ignores_inputs(model.candidate))
      std::erase_if(rows, [&](std::size_t row) { return !fitted->fault_of(data, row).empty(); });
    if (rows.empty()) return out;
    const MapScores scores = mean_scores(predict_or_empty_room(*fitted, records, rows), data,
                                         all_rows(data.size()), (*fitted)->scene);
    for (const Metric m : stability_metrics) out[metric_names[m]] = scores[m];
    return out;
  }

  const StabilityOptions& options_;
  const std::vector<StudyModel> models_ = models_of(options_);
  std::vector<Place> places_;
  const std::vector<bool> mine_ = my_rows();  // by seed, place, model
  StudyFile file_;
  Simulator simulator_;
  Progress progress_;
  std::size_t done_ = 0;
  std::map<std::string, std::optional<TrainedModel>> trained_;  // at the base, with this seed
  std::optional<Dataset> train_data_, test_data_;
  std::set<std::string> reasons_;  // why trainings were refused
};

}  // namespace

StabilityOptions complete(StabilityOptions options) {
  if (options.records == 0) options.records = options.quick ? 1000 : 3600;
  if (options.test_records == 0) options.test_records = options.quick ? 300 : 1000;
  options.base = Simulator(options.sim, options.out, options.threads, options.set).base_condition();
  if (options.models.empty()) {
    const std::string plain = options.quick ? "mlp-128-64" : "mlp-512-256";
    options.models = {"factorised-16",  "silhouette", "pca-mlp",     plain,          plain + ":spd",
                      plain + ":radar", "nearest",    "nearest:spd", "nearest:radar"};
    if (antennas_of(options.base) > 1) options.models = with_profiles(options.models);
  }
  std::erase_if(options.models, ignores_inputs);  // they are always there
  for (const auto& name : options.models) StudyModel{name};
  axes_of(options);
  return options;
}

std::vector<StabilityAxis> axes_of(const StabilityOptions& options) {
  std::vector<StabilityAxis> all = stability_axes(options.base, options.quick);
  if (options.axes.empty()) return all;
  std::vector<std::string> known;
  for (const auto& axis : all) known.push_back(axis.id());
  std::vector<StabilityAxis> out;
  for (const auto& id : options.axes) {
    const auto found = std::find(known.begin(), known.end(), id);
    if (found == known.end())
      throw Error(ExitCode::usage, "axis \"" + id + "\": expected some of " + joined(known, ", "));
    out.push_back(all[static_cast<std::size_t>(found - known.begin())]);
  }
  return out;
}

std::vector<Measurement> study_stability(const StabilityOptions& options) {
  return Study(options).run();
}

}  // namespace echofuse::recon

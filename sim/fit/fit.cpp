// SPDX-License-Identifier: MIT
#include "sim/fit/fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

#include "acquire/record/letter.hpp"
#include "sim/dataset/dataset.hpp"
#include "sim/fit/quantities.hpp"
#include "sim/fit/regression.hpp"
#include "sim/study/each_scene.hpp"

namespace echofuse::sim {
namespace {

struct Simulated {
  Statistics statistics;
  std::map<std::string, double> truth;
};

std::vector<Simulated> simulate(const Twin& twin, const FitOptions& o, double letters,
                                std::uint64_t round) {
  Plan plan;
  plan.conditions = o.nominal;
  plan.twin = to_text(twin);
  plan.laboratories = o.laboratories;
  plan.seed = static_cast<std::int64_t>(o.seed + round);
  const std::int64_t all = o.laboratories * o.records;
  plan.letters = std::llround(letters * static_cast<double>(all));
  plan.people = all - plan.letters;
  const Generator generator(plan);
  const auto conditions = laboratories_of(plan);
  return each_scene<Simulated>(
      "laboratories, round " + std::to_string(round), o.laboratories, o.quiet, [&](std::size_t k) {
        std::vector<record::FusedRecord> records;
        for (std::int64_t i = 0; i < o.records; ++i)
          records.push_back(generator.make(i * o.laboratories + static_cast<std::int64_t>(k)));
        return Simulated{statistics_of(records, {}, o.nominal), quantities_of(conditions[k])};
      });
}

// The statistics that run and laboratories all have, as numbers.
class Table {
 public:
  Table(const std::vector<Simulated>& all, const Statistics& run) {
    for (const auto& [name, value] : run) {
      const auto everywhere = [&, wanted = name](const Simulated& s) {
        return find(s.statistics, wanted) != nullptr;
      };
      if (std::all_of(all.begin(), all.end(), everywhere)) names_.push_back(name);
    }
    const auto columns = static_cast<Eigen::Index>(names_.size());
    x_.resize(static_cast<Eigen::Index>(all.size()), columns);
    at_.resize(columns);
    for (Eigen::Index j = 0; j < columns; ++j) {
      const std::string& name = names_[static_cast<std::size_t>(j)];
      at_[j] = *find(run, name);
      for (std::size_t i = 0; i < all.size(); ++i)
        x_(static_cast<Eigen::Index>(i), j) = *find(all[i].statistics, name);
    }
  }
  Prediction of(const Eigen::VectorXd& y) const { return predict(x_, y, at_); }
  std::vector<std::string> beyond(double spreads) const {
    std::vector<std::string> out;
    for (Eigen::Index j = 0; j < x_.cols(); ++j) {
      const double middle = x_.col(j).mean();
      const double spread = std::sqrt((x_.col(j).array() - middle).square().mean());
      if (std::abs(at_[j] - middle) > spreads * spread + 1e-9)
        out.push_back(names_[static_cast<std::size_t>(j)]);
    }
    return out;
  }

 private:
  static const double* find(const Statistics& all, const std::string& name) {
    for (const auto& [other, value] : all)
      if (other == name) return &value;
    return nullptr;
  }
  std::vector<std::string> names_;
  Eigen::MatrixXd x_;
  Eigen::VectorXd at_;
};

Eigen::VectorXd truths(const std::vector<Simulated>& all, const Estimate& e) {
  Eigen::VectorXd y(static_cast<Eigen::Index>(all.size()));
  for (std::size_t i = 0; i < all.size(); ++i) {
    const double truth = all[i].truth.at(e.name);
    y[static_cast<Eigen::Index>(i)] = e.logarithmic ? std::log(truth) : truth;
  }
  return y;
}

double deviation(const Eigen::VectorXd& y) {
  return std::sqrt((y.array() - y.mean()).square().mean());
}

void estimate(const std::vector<Simulated>& all, const Table& table, Estimate& e) {
  const Prediction p = table.of(truths(all, e));
  e.value = e.logarithmic ? std::exp(p.value) : p.value;
  e.standard_error = p.standard_error;
  e.told = e.before > 0 && e.standard_error < 0.5 * e.before && e.name != "radar_cloth";
}

}  // namespace

double truth_of(const Estimate& e, const Conditions& laboratory) {
  return quantities_of(laboratory).at(e.name);
}

Fit fit_twin(const std::vector<record::FusedRecord>& records, const FitOptions& options) {
  Fit fit;
  fit.empty = empty_room(records);
  const Statistics run = statistics_of(records, fit.empty, options.nominal);
  double letters = 0;
  for (const auto& r : records) {
    if (!shows_one_person(r)) continue;
    ++fit.used;
    letters += record::letter_of(r.label).has_value();
  }
  letters /= static_cast<double>(fit.used);
  for (const auto& [name, value] : run)
    if (name == "signal_counts") fit.signal_counts = value;

  FitOptions o = options;
  o.records = std::clamp<std::int64_t>(fit.used, 20, options.records);
  const Twin prior = twin_named("default");
  const auto first = simulate(prior, o, letters, 1);
  const Table wide(first, run);
  fit.unlike = wide.beyond(5);
  fit.estimates = all_quantities(prior);
  for (Estimate& e : fit.estimates) {
    e.before = deviation(truths(first, e));
    estimate(first, wide, e);
  }
  const auto second = simulate(narrowed(prior, fit.estimates, 3), o, letters, 2);
  const Table near(second, run);
  for (Estimate& e : fit.estimates) {
    const Estimate from_afar = e;
    estimate(second, near, e);
    // The narrow round may have nothing to learn from.
    if (from_afar.told && from_afar.standard_error < e.standard_error) e = from_afar;
    if (!e.told) e.reason = reason_of(e.name);
  }
  return fit;
}

}  // namespace echofuse::sim

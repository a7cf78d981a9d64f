// SPDX-License-Identifier: MIT
#include "recon/trust/domain_shift.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "drivers/core/random.hpp"
#include "recon/files/text.hpp"
#include "recon/numbers/statistics.hpp"
#include "recon/trust/predictors.hpp"

namespace echofuse::recon {
namespace {

// Of fewer training records their spread is not known well enough: 50 would cry wolf.
constexpr std::size_t least_seen = 100, most_records = 2000;
constexpr int resamples = 300;
constexpr std::uint64_t resample_stream = 0x646f6d61;  // "doma"
constexpr double shrinkage = 0.1;    // of the correlations: there may be few records
constexpr double clearly = 4;        // standard errors
constexpr double least_share = 0.1;  // of a record's usual deviation: less is no matter
constexpr double usual = 0.95;

enum class Kind : std::uint8_t { ratio, length, number };
struct Observable {
  const char* name;
  Kind kind;     // ratio: the observable is a logarithm
  double floor;  // of its deviation: what is constant in a training may vary so much
};
constexpr Observable of_spd[] = {{"histogram spread", Kind::ratio, 0.02},
                                 {"histogram skewness", Kind::number, 0.05},
                                 {"background share of the clicks", Kind::number, 0.01},
                                 {"range", Kind::length, 0.01}};
constexpr Observable of_radar[] = {{"radar profile width", Kind::ratio, 0.02},
                                   {"radar skewness", Kind::number, 0.05},
                                   {"radar peak over noise", Kind::ratio, 0.02},
                                   {"radar power before the body", Kind::number, 0.01}};
constexpr Observable of_both[] = {{"radar centroid", Kind::length, 0.005}};

std::vector<Observable> observables(Inputs inputs) {
  std::vector<Observable> out;
  const auto add = [&](const auto& some) {
    for (const Observable& o : some) out.push_back(o);
  };
  if (inputs != Inputs::radar) add(of_spd);
  if (inputs != Inputs::spd) add(of_radar);
  if (both_sensors(inputs)) add(of_both);
  return out;
}

struct Moments {
  double centre, deviation, skewness;  // in points
};

Moments moments_of(const std::vector<double>& weights) {
  double sum = 1e-12, first = 0;
  for (std::size_t i = 0; i < weights.size(); ++i)
    sum += weights[i], first += weights[i] * static_cast<double>(i);
  const double centre = first / sum;
  double second = 0, third = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const double off = static_cast<double>(i) - centre;
    second += weights[i] * off * off, third += weights[i] * off * off * off;
  }
  const double deviation = std::sqrt(second / sum + 1e-6);
  return {centre, deviation, third / sum / std::pow(deviation, 3)};
}

void observe_spd(std::span<const float> histogram, std::span<const float> counts, double range_m,
                 std::vector<float>& out) {
  std::vector<double> clicks(histogram.begin(), histogram.end());
  for (double& v : clicks) v = std::max(v, 0.);
  const Moments m = moments_of(clicks);
  std::vector<float> sorted(counts.begin(), counts.end());
  const double level = double{quantile(sorted, 0.5)};
  const double all = std::accumulate(counts.begin(), counts.end(), 0.0);
  for (const double v : {std::log(m.deviation), m.skewness,
                         level * static_cast<double>(counts.size()) / std::max(all, 1.), range_m})
    out.push_back(static_cast<float>(v));
}

// `body`: the profile about the body, or all of it.
void observe_radar(std::span<const float> body, std::span<const float> power,
                   std::vector<float>& out) {
  std::vector<double> squares(body.begin(), body.end());
  for (double& v : squares) v *= v;  // noise and side lobes hardly pull
  const Moments m = moments_of(squares);
  const auto peak =
      static_cast<std::size_t>(std::max_element(power.begin(), power.end()) - power.begin());
  double before = 0, all = 1e-12;
  for (std::size_t i = 0; i < power.size(); ++i) {
    const double v = std::max(double{power[i]}, 0.);
    all += v, before += 2 * i < peak ? v : 0;
  }
  for (const double v : {std::log(m.deviation), m.skewness,
                         std::log(double{peak_to_noise(power)} + 1), before / all})
    out.push_back(static_cast<float>(v));
}

// Of each row that shows a body.
Matrix observables_of(const Alignment& alignment, const Dataset& data, const Matrix& aligned,
                      const Rows& rows, Inputs inputs) {
  Matrix out(0, observables(inputs).size());
  for (const std::size_t row : rows) {
    std::span<const float> features;
    std::vector<float> one;
    if (inputs != Inputs::radar) {
      features = aligned.row(row);
      if (features.empty() || !shows_body(features)) continue;
      observe_spd(alignment.columns(features).histogram, data.spd.row(row), double{features.back()},
                  one);
    }
    if (inputs != Inputs::spd)
      observe_radar(features.empty() ? data.radar.row(row) : alignment.columns(features).profile,
                    data.radar.row(row), one);
    if (both_sensors(inputs)) one.push_back(static_cast<float>(alignment.displacement_m(features)));
    out.add_row(one);
  }
  return out;
}

// Means of the standardised observables and of their squares, of any rows.
struct Standard {
  std::vector<double> centre, deviation;

  Standard(const Matrix& seen, const std::vector<Observable>& kinds) {
    const ColumnStatistics columns = column_statistics(seen, all_rows(seen.rows));
    centre = columns.mean;
    for (std::size_t c = 0; c < kinds.size(); ++c)
      deviation.push_back(std::max(std::sqrt(columns.variance[c]), kinds[c].floor));
  }
  // A square beyond four deviations counts as four: one stray record is no other world.
  Matrix operator()(const Matrix& seen) const {
    Matrix out(seen.rows, 2 * seen.cols);
    for (std::size_t i = 0; i < seen.rows; ++i)
      for (std::size_t c = 0; c < seen.cols; ++c) {
        const double v = (double{seen.row(i)[c]} - centre[c]) / deviation[c];
        out.row(i)[c] = static_cast<float>(v);
        out.row(i)[seen.cols + c] = static_cast<float>(std::min(v * v, 16.));
      }
    return out;
  }
};

// Both parts of the test, of a difference of means.
struct Statistic {
  double squares, greatest;
};

class Test {
 public:
  Test(const Matrix& table, std::size_t run)
      : columns_(table.cols),
        least_error_(
            0.7 * std::sqrt(1. / static_cast<double>(run) + 1. / static_cast<double>(table.rows))) {
    Rng rng = make_rng(run, resample_stream);
    const ResampledMeans means(table);
    for (int i = 0; i < resamples; ++i) {
      const auto a = means.draw(run, rng), b = means.draw(table.rows, rng);
      for (std::size_t c = 0; c < columns_; ++c) chance_.push_back(a[c] - b[c]);
    }
    learn_covariance();
    for (int i = 0; i < resamples; ++i) {
      const Statistic s = of(std::span(chance_).subspan(static_cast<std::size_t>(i) * columns_));
      squares_.push_back(s.squares), greatest_.push_back(s.greatest);
    }
  }
  Statistic of(std::span<const double> difference) const {
    Statistic out{0, 0};
    std::vector<double> scaled(columns_);
    for (std::size_t c = 0; c < columns_; ++c) {
      scaled[c] = difference[c] / error_[c];
      out.greatest = std::max(out.greatest, std::abs(scaled[c]));
    }
    const Eigen::Map<const Eigen::VectorXd> v(scaled.data(), Eigen::Index(columns_));
    out.squares = v.dot(covariance_.solve(v));
    return out;
  }
  double error(std::size_t column) const { return error_[column]; }
  // As a share of what `usual` of all runs of the training's kind stay below.
  double distance(const Statistic& s) const {
    return std::max(std::sqrt(s.squares / limit(squares_)), s.greatest / limit(greatest_));
  }
  // Of the greater one of two: twice the lesser chance. T^2 as a scaled chi^2 with the mean and the
  // variance of the resampled ones (Wilson and Hilferty, PNAS 17, 684, 1931), single differences as
  // normal ones.
  double p(const Statistic& s) const {
    const double mean = mean_of(squares_), variance = std::pow(standard_deviation(squares_), 2);
    const double freedom = 2 * mean * mean / variance, v = 2 / (9 * freedom);
    const double z = (std::cbrt(s.squares / mean) - 1 + v) / std::sqrt(v);
    const double single = static_cast<double>(columns_) * std::erfc(s.greatest / std::sqrt(2.));
    return std::min(1., 2 * std::min(0.5 * std::erfc(z / std::sqrt(2.)), single));
  }

 private:
  static double limit(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    return values[static_cast<std::size_t>(usual * static_cast<double>(values.size()))];
  }
  void learn_covariance() {
    error_.assign(columns_, 0);
    for (std::size_t i = 0; i < chance_.size(); ++i)
      error_[i % columns_] += chance_[i] * chance_[i] / resamples;
    for (double& e : error_) e = std::max(std::sqrt(e), least_error_);
    const auto size = Eigen::Index(columns_);
    Eigen::MatrixXd of_chance(size, resamples);
    for (std::size_t i = 0; i < chance_.size(); ++i)
      of_chance(Eigen::Index(i % columns_), Eigen::Index(i / columns_)) =
          chance_[i] / error_[i % columns_];
    Eigen::MatrixXd all = (1 - shrinkage) / resamples * (of_chance * of_chance.transpose());
    all.diagonal().setOnes();
    covariance_.compute(all);
  }
  std::size_t columns_;
  double least_error_;          // of what hardly varies in the training
  std::vector<double> chance_;  // differences of means, one resample after the other
  std::vector<double> error_, squares_, greatest_;
  Eigen::LDLT<Eigen::MatrixXd> covariance_;
};

std::string describe(const Observable& o, double difference) {
  if (o.kind == Kind::ratio) return formatted("%s %.2f times", o.name, std::exp(difference));
  if (o.kind == Kind::length) return formatted("%s %+.1f cm", o.name, 100 * difference);
  return formatted("%s %+.2f", o.name, difference);
}

}  // namespace

std::string DomainShift::text() const {
  if (!tested()) return {};
  const std::string number = formatted("domain shift %.1f (above 1: unusual), p %s", distance,
                                       p < 1e-3 ? "< 0.001" : formatted("= %.3f", p).c_str());
  if (!found()) return "this run is like the training: " + number;
  std::string all;
  for (const Difference& d : differences) all += (all.empty() ? ": " : ", ") + d.text;
  return "this run is unlike the training: " + number + all;
}

DomainReference::DomainReference(const Alignment& alignment, const Dataset& data,
                                 const Matrix& aligned, const Rows& rows, Inputs inputs)
    : inputs_(without_antennas(inputs)) {
  const Rows first(rows.begin(),
                   rows.begin() + static_cast<std::ptrdiff_t>(std::min(most_records, rows.size())));
  seen_ = observables_of(alignment, data, aligned, first, inputs_);
  if (seen_.rows < least_seen) seen_ = {};
}

DomainShift DomainReference::judge(const Alignment& alignment, const Dataset& data,
                                   const Matrix& aligned) const {
  Rows rows;
  for (std::size_t row = 0; row < data.size(); ++row)
    if (data.fault_of(row, inputs_).empty()) rows.push_back(row);
  const Matrix found = observables_of(alignment, data, aligned, rows, inputs_);
  if (found.rows < least_records || !known()) return {};
  const auto kinds = observables(inputs_);
  const Standard standard(seen_, kinds);
  const Matrix table = standard(seen_), run = standard(found);
  const Test test(table, found.rows);
  const auto before = column_means(table, all_rows(table.rows)),
             now = column_means(run, all_rows(run.rows));
  std::vector<double> difference(now.size());
  for (std::size_t c = 0; c < now.size(); ++c) difference[c] = now[c] - before[c];
  const Statistic s = test.of(difference);
  DomainShift out{found.rows, test.distance(s), test.p(s), {}};
  for (std::size_t c = 0; c < kinds.size(); ++c) {
    const double clear = std::abs(difference[c]) / test.error(c);
    if (clear > clearly && std::abs(difference[c]) > least_share)
      out.differences.push_back({describe(kinds[c], difference[c] * standard.deviation[c]), clear});
  }
  std::sort(out.differences.begin(), out.differences.end(),
            [](const auto& a, const auto& b) { return a.deviations > b.deviations; });
  return out;
}

void DomainReference::archive(Archive archive, Inputs inputs) {
  inputs_ = without_antennas(inputs);
  archive.table("observables", seen_, Archive::any, observables(inputs_).size());
  archive.require(seen_.rows >= least_seen && seen_.rows <= most_records, "observables",
                  "expected 100 to 2000 records");
}

}  // namespace echofuse::recon

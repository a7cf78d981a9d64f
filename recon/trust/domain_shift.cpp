// SPDX-License-Identifier: MIT
#include "recon/trust/domain_shift.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "drivers/core/random.hpp"
#include "recon/numbers/statistics.hpp"
#include "recon/numbers/text.hpp"

namespace echofuse::recon {
namespace {

using Eigen::ArrayXd, Eigen::MatrixXd, Eigen::VectorXd, Eigen::Index;

constexpr std::size_t most_known = 4000;
constexpr std::size_t block = 10;  // records
constexpr int permutations = 1000;
constexpr std::uint64_t permutation_stream = 0x646f6d61;  // "doma"
constexpr double shrinkage = 0.1;  // shrinks the correlations: there may be few blocks
constexpr double clearly = 4;      // standard errors
// These limits are in units of a record's usual deviation, and of its square. Smaller differences
// do not matter.
constexpr double least_mean = 0.1, least_square = 0.3;
constexpr double most_square = 16;  // one stray record does not make another world
constexpr double usual = 0.95;

// It gives the numbers as deviations from the training's means, and the squares of these: [m x 2
// numbers]. A number that is not known counts as the mean.
class Standard {
 public:
  Standard(const Matrix& known, const std::vector<RecordNumber>& kinds) {
    for (std::size_t c = 0; c < kinds.size(); ++c) {
      double n = 0, sum = 0, squares = 0;
      for (std::size_t i = 0; i < known.rows; ++i) {
        const auto v = double{known.row(i)[c]};
        if (!std::isnan(v)) ++n, sum += v, squares += v * v;
      }
      share_.push_back(n / static_cast<double>(known.rows));
      centre_.push_back(n > 0 ? sum / n : 0);
      const double variance = n > 0 ? squares / n - centre_.back() * centre_.back() : 0;
      deviation_.push_back(std::max(std::sqrt(std::max(variance, 0.)), kinds[c].floor));
    }
  }
  bool known(std::size_t c) const { return share_[c] > 0.5; }
  double deviation(std::size_t c) const { return deviation_[c]; }
  MatrixXd operator()(const Matrix& numbers) const {
    const auto n = Index(centre_.size());
    MatrixXd out = MatrixXd::Zero(Index(numbers.rows), 2 * n);
    for (std::size_t i = 0; i < numbers.rows; ++i)
      for (std::size_t c = 0; c < centre_.size(); ++c) {
        const double v = (double{numbers.row(i)[c]} - centre_[c]) / deviation_[c];
        if (std::isnan(v) || !known(c)) continue;
        out(Index(i), Index(c)) = v;
        out(Index(i), n + Index(c)) = std::min(v * v, most_square);
      }
    return out;
  }

 private:
  std::vector<double> share_, centre_, deviation_;
};

// It returns means of ten rows each; the rows left over at the end belong to no block.
MatrixXd block_means(const MatrixXd& rows) {
  const auto size = Index(block), blocks = rows.rows() / size;
  MatrixXd out(blocks, rows.cols());
  for (Index b = 0; b < blocks; ++b) out.row(b) = rows.middleRows(b * size, size).colwise().mean();
  return out;
}

// It draws `count` blocks at random, and returns the differences of their mean and the mean of the
// others: one draw a row.
MatrixXd permuted(const MatrixXd& blocks, Index count) {
  const VectorXd all = blocks.colwise().sum();
  const auto others = static_cast<double>(blocks.rows() - count);
  Rng rng = make_rng(static_cast<std::uint64_t>(blocks.rows()), permutation_stream);
  std::vector<Index> order(static_cast<std::size_t>(blocks.rows()));
  std::iota(order.begin(), order.end(), 0);
  MatrixXd out(permutations, blocks.cols());
  for (Index k = 0; k < permutations; ++k) {
    VectorXd some = VectorXd::Zero(blocks.cols());
    for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
      std::uniform_int_distribution<std::size_t> from(i, order.size() - 1);
      std::swap(order[i], order[from(rng)]);
      some += blocks.row(order[i]).transpose();
    }
    out.row(k) = some / static_cast<double>(count) - (all - some) / others;
  }
  return out;
}

struct Tested {
  double distance, p;
};

// It tests a difference of means against the differences that permutations give.
Tested test(const VectorXd& difference, const MatrixXd& chance, double least_error) {
  const Index half = chance.rows() / 2;
  const MatrixXd fit = chance.topRows(half), null = chance.bottomRows(half);
  const ArrayXd error = (fit.array().square().colwise().mean().sqrt()).max(least_error);
  const MatrixXd scaled = fit.array().rowwise() / error.transpose();
  MatrixXd covariance = (1 - shrinkage) / static_cast<double>(half) * (scaled.transpose() * scaled);
  covariance.diagonal().setOnes();
  const Eigen::LDLT<MatrixXd> solver(covariance);
  const auto squares = [&](const VectorXd& v) {
    const VectorXd s = (v.array() / error).matrix();
    return s.dot(solver.solve(s));
  };
  std::vector<double> by_chance;
  for (Index k = 0; k < half; ++k) by_chance.push_back(squares(null.row(k)));
  const double found = squares(difference);
  // This is a scaled chi^2 with the mean and variance of these values (Wilson and Hilferty, PNAS
  // 17, 684, 1931).
  const double mean = mean_of(by_chance), variance = std::pow(standard_deviation(by_chance), 2);
  const double freedom = 2 * mean * mean / variance, v = 2 / (9 * freedom);
  const double z = (std::cbrt(found / mean) - 1 + v) / std::sqrt(v);
  std::sort(by_chance.begin(), by_chance.end());
  const double limit =
      by_chance[static_cast<std::size_t>(usual * static_cast<double>(by_chance.size()))];
  return {std::sqrt(found / limit), 0.5 * std::erfc(z / std::sqrt(2.))};
}

// Returns the standard errors of the difference of two means, from the scatter of the blocks about
// each mean.
ArrayXd standard_errors(const MatrixXd& a, const MatrixXd& b, double least_error) {
  const auto about_mean = [](const MatrixXd& m) -> ArrayXd {
    return (m.rowwise() - m.colwise().mean()).array().square().colwise().sum().transpose();
  };
  const auto n = static_cast<double>(a.rows()), m = static_cast<double>(b.rows());
  return ((about_mean(a) + about_mean(b)) / std::max(n + m - 2, 1.) * (1 / n + 1 / m))
      .sqrt()
      .max(least_error);
}

std::string describe(const RecordNumber& number, double difference, double error) {
  if (number.kind == RecordNumber::Kind::ratio)
    return formatted("%s %.2f +- %.2f times", number.name, std::exp(difference),
                     error * std::exp(difference));
  if (number.kind == RecordNumber::Kind::length)
    return formatted("%s %+.1f +- %.1f cm", number.name, 100 * difference, 100 * error);
  return formatted("%s %+.2f +- %.2f", number.name, difference, error);
}

std::string range_advice(double difference_m, double error_m) {
  return formatted(
      "the radar's ranges look %.1f +- %.1f cm too %s, or people stand further %s, or reflect "
      "otherwise; if it is the radar: --range-offset %.3f, and calibrate",
      100 * std::abs(difference_m), 100 * error_m, difference_m > 0 ? "long" : "short",
      difference_m > 0 ? "right" : "left", difference_m);
}

}  // namespace

std::string DomainShift::text() const {
  if (!tested()) return {};
  const std::string number = formatted("domain shift %.1f (above 1: unusual), p %s", distance,
                                       p < 1e-3 ? "< 0.001" : formatted("= %.3f", p).c_str());
  if (!found())
    return std::string("this run is like the training") +
           (p < most_p ? " (what surely differs is too little to matter): " : ": ") + number;
  std::string all;
  for (const Difference& d : differences) all += (all.empty() ? ": " : ", ") + d.text;
  return "this run is unlike the training: " + number + all + (advice.empty() ? "" : "; " + advice);
}

DomainReference::DomainReference(const Alignment& alignment, const Dataset& data,
                                 const Matrix& views, const Rows& rows, Inputs inputs)
    : inputs_(without_antennas(inputs)) {
  const Rows first(rows.begin(),
                   rows.begin() + static_cast<std::ptrdiff_t>(std::min(most_known, rows.size())));
  numbers_ = record_numbers_of(alignment, data, views, first, inputs_);
  if (numbers_.rows < least_known) numbers_ = {};
}

DomainShift DomainReference::judge(const Alignment& alignment, const Dataset& data,
                                   const Matrix& views) const {
  Rows rows;
  for (std::size_t row = 0; row < data.size(); ++row)
    if (data.fault_of(row, inputs_).empty()) rows.push_back(row);
  const Matrix found = record_numbers_of(alignment, data, views, rows, inputs_);
  if (found.rows < least_records || !known()) return {};
  const auto kinds = record_numbers(inputs_);
  const Standard standard(numbers_, kinds), own(found, kinds);
  MatrixXd before = block_means(standard(numbers_)), now = block_means(standard(found));
  const auto numbers = Index(kinds.size());
  DomainShift out{found.rows, 0, 1, {}, {}};
  for (Index c = 0; c < numbers; ++c) {
    const auto k = static_cast<std::size_t>(c);
    if (!standard.known(k) || own.known(k)) continue;
    // A number that this run does not have is not compared; a run with one carrier only differs.
    before.col(c).setZero(), before.col(numbers + c).setZero();
    now.col(c).setZero(), now.col(numbers + c).setZero();
    if (kinds[k].name == power_variation_numbers[1].name)
      out.differences.push_back({"one carrier of the radar, several in training", INFINITY});
  }
  const double least_error = 0.7 * std::sqrt(1. / static_cast<double>(found.rows) +
                                             1. / static_cast<double>(numbers_.rows));
  const VectorXd difference = now.colwise().mean() - before.colwise().mean();
  MatrixXd both(before.rows() + now.rows(), before.cols());
  both << before, now;
  const Tested t = test(difference, permuted(both, now.rows()), least_error);
  out.distance = t.distance, out.p = out.differences.empty() ? t.p : 0;
  const ArrayXd error = standard_errors(before, now, least_error);
  for (Index c = 0; c < numbers; ++c) {
    const RecordNumber& number = kinds[static_cast<std::size_t>(c)];
    const double unit = standard.deviation(static_cast<std::size_t>(c));
    const double clear = std::abs(difference[c]) / error[c];
    const double squares = std::abs(difference[numbers + c]) / error[numbers + c];
    if (clear > clearly && std::abs(difference[c]) > least_mean) {
      out.differences.push_back({describe(number, difference[c] * unit, error[c] * unit), clear});
      if (number.radar_range && alignment.array_features() == 0)
        out.advice = range_advice(difference[c] * unit, error[c] * unit);
    } else if (squares > clearly && std::abs(difference[numbers + c]) > least_square) {
      out.differences.push_back(
          {formatted("%s scatters %s", number.name, difference[numbers + c] > 0 ? "more" : "less"),
           squares});
    }
  }
  // Another room or other people differ in more than one number.
  if (out.differences.size() > 1) out.advice.clear();
  std::sort(out.differences.begin(), out.differences.end(),
            [](const auto& a, const auto& b) { return a.standard_errors > b.standard_errors; });
  return out;
}

void DomainReference::archive(Archive archive, Inputs inputs) {
  inputs_ = without_antennas(inputs);
  constexpr float not_known = -1e9f;
  Matrix table = numbers_;
  for (float& v : table.values) v = std::isnan(v) ? not_known : v;
  archive.table("numbers", table, Archive::any, record_numbers(inputs_).size());
  for (float& v : table.values) v = v == not_known ? NAN : v;
  numbers_ = std::move(table);
  archive.require(numbers_.rows >= least_known && numbers_.rows <= most_known, "numbers",
                  "expected 50 to 4000 records");
}

}  // namespace echofuse::recon

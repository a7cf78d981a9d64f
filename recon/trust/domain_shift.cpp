// SPDX-License-Identifier: MIT
#include "recon/trust/domain_shift.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "drivers/core/random.hpp"
#include "drivers/util/format.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

using Eigen::ArrayXd, Eigen::MatrixXd, Eigen::VectorXd, Eigen::Index;

constexpr Index count = record_number_count;
constexpr std::size_t max_known = 4000;
// Number of successive records in one block of the permutation test.
constexpr std::size_t block = 10;
constexpr int permutations = 4000;
constexpr std::uint64_t permutation_stream = 0x646f6d61;  // "doma" in ASCII
// Minimum significance of a difference, in standard errors.
constexpr double clearly = 4;
// A difference below this number of standard errors does not widen the intervals.
constexpr double not_by_chance = 3;
constexpr double min_factor = 1.05, max_factor = 10;
// Differences below these limits are ignored. `min_mean` is in units of the standard deviation
// between records, and `min_square` is in units of the variance between records.
constexpr double min_mean = 0.1, min_square = 0.3;
// Squared deviations are clipped to this value, so that a single outlier has little weight.
constexpr double max_square = 16;

// Converts the descriptive numbers of m records to deviations from the training means, in standard
// deviations, followed by the squares of these deviations: [m x 2 record_number_count]. Both are
// zero for a missing number.
class Standard {
 public:
  explicit Standard(const Matrix& known) {
    for (std::size_t c = 0; c < record_number_count; ++c) {
      std::vector<double> values;
      for (std::size_t i = 0; i < known.rows; ++i)
        if (const auto v = double{known.row(i)[c]}; !std::isnan(v)) values.push_back(v);
      known_[c] = 2 * values.size() > known.rows;
      if (!known_[c]) continue;
      centre_[c] = mean_of(values);
      deviation_[c] = std::max(standard_deviation(values), record_numbers[c].floor);
    }
  }
  bool known(std::size_t c) const { return known_[c]; }
  double deviation(std::size_t c) const { return deviation_[c]; }
  MatrixXd operator()(const Matrix& numbers) const {
    MatrixXd out = MatrixXd::Zero(Index(numbers.rows), 2 * count);
    for (std::size_t i = 0; i < numbers.rows; ++i)
      for (std::size_t c = 0; c < record_number_count; ++c) {
        const double v = (double{numbers.row(i)[c]} - centre_[c]) / deviation_[c];
        if (std::isnan(v) || !known_[c]) continue;
        out(Index(i), Index(c)) = v;
        out(Index(i), count + Index(c)) = std::min(v * v, max_square);
      }
    return out;
  }

 private:
  std::array<bool, record_number_count> known_{};
  std::array<double, record_number_count> centre_{}, deviation_{};
};

// Returns the means of blocks of ten successive rows, and drops the remaining rows.
MatrixXd block_means(const MatrixXd& rows) {
  const auto size = Index(block), blocks = rows.rows() / size;
  MatrixXd out(blocks, rows.cols());
  for (Index b = 0; b < blocks; ++b) out.row(b) = rows.middleRows(b * size, size).colwise().mean();
  return out;
}

// Selects `drawn` blocks at random, several thousand times. Returns one row per selection: the mean
// of the selected blocks minus the mean of the other blocks.
MatrixXd permuted(const MatrixXd& blocks, Index drawn) {
  const VectorXd all = blocks.colwise().sum();
  const auto others = static_cast<double>(blocks.rows() - drawn);
  Rng rng = make_rng(static_cast<std::uint64_t>(blocks.rows()), permutation_stream);
  std::vector<Index> order(static_cast<std::size_t>(blocks.rows()));
  std::iota(order.begin(), order.end(), 0);
  MatrixXd out(permutations, blocks.cols());
  for (Index k = 0; k < permutations; ++k) {
    VectorXd some = VectorXd::Zero(blocks.cols());
    for (std::size_t i = 0; i < static_cast<std::size_t>(drawn); ++i) {
      std::uniform_int_distribution<std::size_t> from(i, order.size() - 1);
      std::swap(order[i], order[from(rng)]);
      some += blocks.row(order[i]).transpose();
    }
    out.row(k) = some / static_cast<double>(drawn) - (all - some) / others;
  }
  return out;
}

// Returns the p-value of the largest difference between means; each difference is divided by its
// standard deviation over the permutations. Compares the largest difference with the largest
// difference of each permutation, which corrects for multiple tests (Westfall and Young,
// Resampling-Based Multiple Testing, 1993).
double p_of(const VectorXd& difference, const MatrixXd& chance, double min_error) {
  const ArrayXd error = chance.array().square().colwise().mean().sqrt().max(min_error);
  const auto greatest = [&](const VectorXd& v) { return (v.array() / error).abs().maxCoeff(); };
  const double found = greatest(difference);
  std::vector<double> by_chance;
  for (Index k = 0; k < chance.rows(); ++k) by_chance.push_back(greatest(chance.row(k)));
  std::sort(by_chance.begin(), by_chance.end());
  const auto above = by_chance.end() - std::lower_bound(by_chance.begin(), by_chance.end(), found);
  return static_cast<double>(above + 1) / (permutations + 1);
}

// Returns the standard errors of the difference between two means, estimated from the variance
// between blocks.
ArrayXd standard_errors(const MatrixXd& a, const MatrixXd& b, double min_error) {
  const auto about_mean = [](const MatrixXd& m) -> ArrayXd {
    return (m.rowwise() - m.colwise().mean()).array().square().colwise().sum().transpose();
  };
  const auto n = static_cast<double>(a.rows()), m = static_cast<double>(b.rows());
  return ((about_mean(a) + about_mean(b)) / std::max(n + m - 2, 1.) * (1 / n + 1 / m))
      .sqrt()
      .max(min_error);
}

std::string describe(const RecordNumber& number, double difference, double error) {
  if (number.kind == RecordNumber::Kind::ratio)
    return format("%s %.2f +- %.2f times that in training", number.name, std::exp(difference),
                  error * std::exp(difference));
  if (number.kind == RecordNumber::Kind::length)
    return format("%s %+.1f +- %.1f cm", number.name, 100 * difference, 100 * error);
  return format("%s %+.2f +- %.2f", number.name, difference, error);
}

// Returns the contribution of a number to the square of the interval factor, from its difference
// and standard error in standard deviations. Other bodies may differ in shape by several standard
// deviations, but then the interval does not need to grow further.
double widening_by(const RecordNumber& number, double difference, double error) {
  constexpr double max_of_shape = 1;
  double size = std::abs(difference);
  if (number.kind != RecordNumber::Kind::length) size = std::min(size, max_of_shape);
  return std::pow(number.widening, 2) *
         std::max(0., std::pow(size, 2) - std::pow(not_by_chance * error, 2));
}

std::string range_advice(double difference_m, double error_m) {
  return format(
      "radar ranges are %.1f +- %.1f cm too %s, or people are farther to the %s or reflect "
      "differently than in training; if the radar is the cause, use --range-offset %.3f and "
      "calibrate",
      100 * std::abs(difference_m), 100 * error_m, difference_m > 0 ? "long" : "short",
      difference_m > 0 ? "right" : "left", difference_m);
}

}  // namespace

bool DomainShift::mostly_flagged() const {
  return assessed >= DomainReference::min_records && 2 * flagged > assessed;
}

std::string DomainShift::text() const {
  if (!tested()) return {};
  const std::string p_text = p < max_p ? format("p < %g", max_p) : format("p = %.3f", p);
  const std::string wider =
      interval_factor > 1 ? format("; its 90 %% intervals are %.1f times as wide", interval_factor)
                          : "";
  if (!found())
    return std::string("this run matches the training data") +
           (p < max_p ? " (significant differences are too small to matter): " : ": ") + p_text +
           wider;
  std::string all;
  const auto add = [&](const std::string& text) { all += (all.empty() ? "" : "; ") + text; };
  if (mostly_flagged())
    add(format("%zu of %zu records are unusual (most: %s)", flagged, assessed, reason.c_str()));
  if (p < max_p && !differences.empty()) {
    add(p_text + ": " + differences[0].text);
    for (std::size_t i = 1; i < differences.size(); ++i) all += ", " + differences[i].text;
  }
  if (!range_difference.empty())
    add(range_difference);
  else if (p < max_p && !advice.empty())
    add(advice);
  return "this run differs from the training data: " + all + wider;
}

DomainReference::DomainReference(const Alignment& alignment, const Dataset& data,
                                 const Matrix& views, const Rows& rows, Inputs inputs)
    : inputs_(without_antennas(inputs)) {
  const Rows first(rows.begin(),
                   rows.begin() + static_cast<std::ptrdiff_t>(std::min(max_known, rows.size())));
  numbers_ = record_numbers_of(alignment, data, views, first, inputs_);
  if (numbers_.rows < min_known) numbers_ = {};
  if (known() && both_sensors(inputs)) echoes_ = StaticEchoes(data, first);
}

DomainShift DomainReference::test(const Alignment& alignment, const Dataset& data,
                                  const Matrix& views) const {
  Rows rows;
  for (std::size_t row = 0; row < data.size(); ++row)
    if (fault_of(data, row, inputs_).empty()) rows.push_back(row);
  DomainShift out = test_numbers(record_numbers_of(alignment, data, views, rows, inputs_),
                                 alignment.array_features() == 0);
  // Models with antennas do not locate bodies by the difference of the ranges.
  if (alignment.array_features() > 0) return out;
  if (const auto range = echoes_.compare(data, rows); range && range->found())
    out.range_difference = range->text();
  return out;
}

DomainShift DomainReference::test_numbers(const Matrix& found, bool range_matters) const {
  if (found.rows < min_records || !known()) return {};
  const Standard standard(numbers_), own(found);
  MatrixXd before = block_means(standard(numbers_)), now = block_means(standard(found));
  DomainShift out{.records = found.rows};
  for (std::size_t k = 0; k < record_number_count; ++k) {
    if (!standard.known(k) || own.known(k)) continue;
    // If the tested run lacks quantity k, sets its differences to 0.
    for (const Index c : {Index(k), count + Index(k)})
      before.col(c).setZero(), now.col(c).setZero();
  }
  const double min_error = 0.7 * std::sqrt(1. / static_cast<double>(found.rows) +
                                           1. / static_cast<double>(numbers_.rows));
  const VectorXd difference = now.colwise().mean() - before.colwise().mean();
  MatrixXd both(before.rows() + now.rows(), before.cols());
  both << before, now;
  out.p = p_of(difference, permuted(both, now.rows()), min_error);
  const ArrayXd error = standard_errors(before, now, min_error);
  double widening = 1, of_range = 0;
  for (std::size_t k = 0; k < record_number_count; ++k) {
    const RecordNumber& number = record_numbers[k];
    const Index mean = Index(k), square = count + Index(k);
    const double clear = std::abs(difference[mean]) / error[mean];
    const double squares = std::abs(difference[square]) / error[square];
    // Models with antennas do not locate bodies by the difference of the ranges.
    if (k != radar_range_number || range_matters)
      widening += widening_by(number, difference[mean], error[mean]);
    const double off = difference[mean] * standard.deviation(k);
    const double off_error = error[mean] * standard.deviation(k);
    if (clear > clearly && std::abs(difference[mean]) > min_mean) {
      out.differences.push_back({describe(number, off, off_error), clear});
      if (k == radar_range_number && range_matters)
        out.advice = range_advice(off, off_error), of_range = clear;
    } else if (squares > clearly && std::abs(difference[square]) > min_square) {
      out.differences.push_back(
          {format("%s scatters %s", number.name, difference[square] > 0 ? "more" : "less"),
           squares});
    }
  }
  out.interval_factor = std::min(std::sqrt(widening), max_factor);
  if (out.interval_factor < min_factor) out.interval_factor = 1;
  std::sort(out.differences.begin(), out.differences.end(),
            [](const auto& a, const auto& b) { return a.standard_errors > b.standard_errors; });
  // Two people or an empty room also change the radar range, but other numbers more.
  if (!out.differences.empty() && of_range < out.differences[0].standard_errors / 3)
    out.advice.clear();
  return out;
}

void DomainReference::archive(Archive archive, Inputs inputs, const Layout& layout) {
  inputs_ = without_antennas(inputs);
  constexpr float not_known = -1e9f;
  Matrix table = numbers_;
  for (float& v : table.values) v = std::isnan(v) ? not_known : v;
  archive.table("numbers", table, Archive::any, record_number_count);
  for (float& v : table.values) v = v == not_known ? NAN : v;
  numbers_ = std::move(table);
  archive.require(numbers_.rows >= min_known && numbers_.rows <= max_known, "numbers",
                  "expected 50 to 4000 records");
  if (archive.part("knows_static_echoes", echoes_.known()))
    echoes_.archive(archive.in("static"), layout);
}

}  // namespace echofuse::recon

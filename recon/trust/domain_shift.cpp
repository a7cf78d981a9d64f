// SPDX-License-Identifier: MIT
#include "recon/trust/domain_shift.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/util/format.hpp"
#include "recon/numbers/permutation_test.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t max_known = 4000;
// Minimum number of standard errors of a difference that is stated, and of one that widens the
// intervals.
constexpr double clearly = 4, not_by_chance = 3;
// Smaller differences are ignored; in standard deviations and in variances.
constexpr double min_mean = 0.1, min_variance = 0.3;
constexpr double min_factor = 1.05, max_factor = 10;
// Other bodies may differ in shape by more standard deviations, but then the interval does not need
// to grow further.
constexpr double max_of_shape = 1;

std::string describe(const RecordNumber& number, double difference, double error) {
  if (number.in_run.kind == RunNumber::Kind::ratio)
    return format("%s %.2f +- %.2f times that in training", number.name, std::exp(difference),
                  error * std::exp(difference));
  if (number.in_run.kind == RunNumber::Kind::length)
    return format("%s %+.1f +- %.1f cm", number.name, 100 * difference, 100 * error);
  return format("%s %+.2f +- %.2f", number.name, difference, error);
}

}  // namespace

bool DomainShift::mostly_flagged() const {
  return assessed >= DomainReference::min_records && 2 * flagged > assessed;
}

std::string DomainShift::text() const {
  if (!tested()) return {};
  const bool significant = p < max_p;
  const std::string p_text = significant ? format("p < %g", max_p) : format("p = %.3f", p);
  const std::string wider =
      interval_factor > 1 ? format("; its 90 %% intervals are %.1f times as wide", interval_factor)
                          : "";
  if (!found())
    return std::string("this run matches the training data") +
           (significant ? " (significant differences are too small to matter): " : ": ") + p_text +
           wider;
  // The advice is that of the static echoes, of the largest differences, or of the most frequent
  // flag. Two people also change the radar range, but other numbers more.
  std::string all, advice;
  const auto add = [&](const char* before, const std::string& text) {
    if (!text.empty()) all += (all.empty() ? "" : before) + text;
  };
  if (mostly_flagged())
    add("", format("%zu of %zu records are unusual (most: %s)", flagged, assessed, reason.c_str()));
  for (std::size_t i = 0; significant && i < differences.size(); ++i) {
    const auto& [what, errors, remedy] = differences[i];
    add(i > 0 ? ", " : "; ", (i > 0 ? "" : p_text + ": ") + what);
    if (errors >= differences[0].standard_errors / 3) advice += remedy;
  }
  for (const RecordNumber& number : record_numbers)
    if (mostly_flagged() && advice.empty() && reason == number.name) advice = number.advice;
  add("; ", range_difference.empty() ? advice : range_difference);
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
  DomainShift out;
  // Models with antennas do not locate bodies by the difference of the ranges.
  const bool range_matters = alignment.array_features() == 0;
  if (range_matters)
    if (const auto range = echoes_.compare(data, rows); range && range->found())
      out.range_difference = range->text();
  const Matrix found = record_numbers_of(alignment, data, views, rows, inputs_);
  if (found.rows < min_records || !known()) return out;
  std::vector<double> floors;
  for (std::size_t k = 0; k < run_numbers; ++k) floors.push_back(record_numbers[k].in_run.floor);
  const auto [deviation, difference, error, p] = compare_tables(numbers_, found, floors);
  out.records = found.rows, out.p = p;
  double widening = 1;
  for (std::size_t k = 0; k < run_numbers; ++k) {
    const RecordNumber& number = record_numbers[k];
    const bool matters = k != radar_range_number || range_matters;
    const double mean = difference[k], variance = difference[run_numbers + k];
    const double size = number.in_run.kind == RunNumber::Kind::length
                            ? std::abs(mean)
                            : std::min(std::abs(mean), max_of_shape);
    if (matters)
      widening += std::pow(number.in_run.widening, 2) *
                  std::max(0., std::pow(size, 2) - std::pow(not_by_chance * error[k], 2));
    const double means = std::abs(mean) / error[k],
                 variances = std::abs(variance) / error[run_numbers + k];
    if (means > clearly && std::abs(mean) > min_mean) {
      const double off = mean * deviation[k], off_error = error[k] * deviation[k];
      const auto advise = matters ? number.in_run.advice : nullptr;
      out.differences.push_back(
          {describe(number, off, off_error), means, advise ? advise(off, off_error) : ""});
    } else if (variances > clearly && std::abs(variance) > min_variance) {
      const char* how = variance > 0 ? "more" : "less";
      out.differences.push_back({format("%s scatters %s", number.name, how), variances, ""});
    }
  }
  out.interval_factor = std::min(std::sqrt(widening), max_factor);
  if (out.interval_factor < min_factor) out.interval_factor = 1;
  std::sort(out.differences.begin(), out.differences.end(),
            [](const auto& a, const auto& b) { return a.standard_errors > b.standard_errors; });
  return out;
}

void DomainReference::archive(Archive archive, Inputs inputs, const Layout& layout) {
  inputs_ = without_antennas(inputs);
  constexpr float not_known = -1e9f;
  for (float& v : numbers_.values) v = std::isnan(v) ? not_known : v;
  archive.table("numbers", numbers_, Archive::any, run_numbers);
  std::ranges::replace(numbers_.values, not_known, NAN);
  archive.require(numbers_.rows >= min_known && numbers_.rows <= max_known, "numbers",
                  "expected 50 to 4000 records");
  if (archive.part("knows_static_echoes", echoes_.known()))
    echoes_.archive(archive.in("static"), layout);
}

}  // namespace echofuse::recon

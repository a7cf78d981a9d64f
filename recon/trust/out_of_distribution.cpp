// SPDX-License-Identifier: MIT
#include "recon/trust/out_of_distribution.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <random>

#include "drivers/core/random.hpp"
#include "drivers/util/format.hpp"
#include "recon/data/response_conversion.hpp"
#include "recon/data/split.hpp"
#include "recon/method/method.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t held_stream = 0x68656c64;  // "held" in ASCII
// All folds set the limits of T^2 and Q, because the tail of one fold has too few records. The
// detection of two bodies is slow to train: with at least `few_records` records, only the last fold
// sets its limit. With `many_records` records, there are `folds_of_many`.
constexpr std::size_t folds_of_few = 4, folds_of_many = 10, few_records = 400, many_records = 3000;
// Allowed false alarm rate of T^2, of two bodies, and of the Q of all groups together.
constexpr double rate = 0.002, q_rate = rate / 6;
constexpr std::array rates{q_rate, q_rate, q_rate, q_rate, q_rate, q_rate, rate, rate};
constexpr double no_body_log_odds = -30;  // log odds of two bodies if a record shows no body
// Margin of the range limits, as a fraction of the training span.
constexpr double range_reserve = 0.05;
// Limit of the clicks per pulse, as a factor of the maximum in training.
constexpr double clicks_reserve = 1.25;
// A record without a body is unusual if more than this fraction of the training records show one.
constexpr double nearly_all_records = 0.99;

std::vector<double> learnt_numbers(const RecordValues& m) {
  std::vector<double> out;
  for (const RecordNumber& number : std::span(record_numbers).subspan(first_learnt))
    out.push_back(number.of(m));
  return out;
}

}  // namespace

void OutOfDistributionDetector::use(const Features& sensors, const Alignment& alignment) {
  if (sensors.spd_count() > 0) std::ranges::copy(alignment.groups(), first_.begin());
  first_[groups] = first_[profile] + sensors.radar_count();
}

Rows OutOfDistributionDetector::learn_ranges(const Matrix& descriptions) {
  Rows out;
  std::vector<double> ranges_m;
  for (std::size_t i = 0; i < descriptions.rows; ++i) {
    // Without an SPD, this value is not a range, and the limits are not used.
    const auto range_m = double{descriptions.row(i)[first_[range]]};
    if (range_m != 0 || first_[profile] == 0) out.push_back(i), ranges_m.push_back(range_m);
  }
  if (out.empty()) return out;
  const auto [nearest_m, farthest_m] = std::ranges::minmax(ranges_m);
  const double reserve_m = range_reserve * (farthest_m - nearest_m);
  nearest_m_ = nearest_m - reserve_m, farthest_m_ = farthest_m + reserve_m;
  return out;
}

Matrix OutOfDistributionDetector::describe(const Matrix& views, const Dataset& data,
                                           const Rows& rows) const {
  Matrix out(rows.size(), first_[groups]);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    std::ranges::copy(views.row(i).last(first_[profile]), out.row(i).begin());
    const auto whole = out.row(i).subspan(first_[profile]);
    if (whole.empty()) continue;
    const auto power = beyond_leakage(data.radar(), rows[i]);
    std::ranges::copy(power, whole.last(power.size()).begin());
    normalise(whole);
  }
  return out;
}

OutOfDistributionDetector::OutOfDistributionDetector(const Alignment& alignment,
                                                     const Dataset& data, const Matrix& views,
                                                     const Rows& rows, Inputs inputs,
                                                     const SceneModel& scene, std::uint64_t seed) {
  const Features sensors = fit_features(
      data, rows, alignment.array_features() > 0 ? inputs : without_antennas(inputs), raw_scaling);
  use(sensors, alignment);
  const bool has_spd = sensors.spd_count() > 0;
  const Matrix all = describe(take_rows(views, rows), data, rows);
  for (const std::size_t row : rows)
    max_clicks_per_start_ = std::max(max_clicks_per_start_, data.records[row].clicks_per_pulse);
  const Rows with_body = learn_ranges(all);
  share_with_body_ = static_cast<double>(with_body.size()) / static_cast<double>(rows.size());
  const auto rows_of = [&](Rows part) {
    for (std::size_t& i : part) i = rows[i];
    return part;
  };
  // Records labelled as two people must not define what a single body looks like.
  const auto shows_two = [&](std::size_t i) {
    return data.records[rows[i]].label == two_people_label;
  };
  const auto learn = [&](Rows part, bool learns_two) {
    Rows usual;
    std::ranges::sort(part);
    std::ranges::set_intersection(part, with_body, std::back_inserter(usual));
    if (usual.size() < min_records / 2) usual = part;
    distances_.fit(take_rows(all, usual), first_, seed);
    std::erase_if(usual, shows_two);
    if (has_spd && learns_two)
      two_bodies_ = learn_two_bodies(alignment, sensors, data, views, rows_of(usual), scene, seed);
  };
  Rng rng = make_rng(seed, held_stream);
  Rows order = all_rows(rows.size());  // shuffled, because similar records are contiguous
  std::shuffle(order.begin(), order.end(), rng);
  const bool few = rows.size() < few_records;
  const std::size_t parts = rows.size() < many_records ? folds_of_few : folds_of_many;
  const WiderRadars wider(data, rows, inputs);
  // Numbers of held-out records, unconverted and with each wider radar.
  std::vector<Matrix> held(1 + wider.size(), Matrix(0, numbers));
  for (std::size_t part = 0; part < parts; ++part) {
    const Split fold = make_fold(order, part, parts, 0);
    const bool learns_two = few || part + 1 == parts;
    learn(fold.train, learns_two);
    for (std::size_t k = 0; k < held.size(); ++k) {
      const Matrix descriptions =
          k == 0
              ? take_rows(all, fold.test)
              : describe(wider.imitated(k - 1, data, rows_of(fold.test), rng), sensors, alignment);
      for (std::size_t i = 0; i < descriptions.rows; ++i) {
        const std::vector<double> found = learnt_numbers(measure(descriptions.row(i)));
        held[k].add_row(std::vector<float>(found.begin(), found.end()));
        // The log odds of two bodies do not always set the limit.
        if (!learns_two || shows_two(fold.test[i])) held[k].row(held[k].rows - 1)[two] = NAN;
      }
    }
  }
  if (few) learn(order, true);
  for (std::size_t k = 0; k < held.size(); ++k)
    limits_.add(k == 0 ? 1 : wider.times_wider(k - 1), held[k], rates);
}

Matrix OutOfDistributionDetector::describe(const Dataset& data, const Features& sensors,
                                           const Alignment& alignment) const {
  const Rows all = all_rows(data.size());
  return describe(sensors.spd_count() > 0 ? align(observe(data, all, sensors), alignment)
                                          : Matrix(all.size(), 0),
                  data, all);
}

RecordValues OutOfDistributionDetector::measure(std::span<const float> description) const {
  RecordValues out;
  out.distances = distances_(description, first_);
  out.two_bodies = no_body_log_odds;
  if (first_[profile] > 0) out.range_m = double{description[first_[range]]};
  out.empty = out.range_m == 0;
  if (out.empty > 0)
    out.range_m = NAN;
  else if (two_bodies_.known())
    out.two_bodies = two_bodies_(description.first(first_[profile]));
  return out;
}

std::vector<OutOfDistributionScore> OutOfDistributionDetector::score(const Matrix& views,
                                                                     const Dataset& data,
                                                                     const Rows& rows) const {
  const Matrix descriptions = describe(views, data, rows);
  std::vector<OutOfDistributionScore> out;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    RecordValues m = measure(descriptions.row(i));
    if (first_[profile] > 0) m.clicks_per_pulse = data.records[rows[i]].clicks_per_pulse;
    auto share = limits_.shares(learnt_numbers(m), times_wider(data, rows[i]));
    for (std::size_t g = 0; g < groups; ++g)
      if (first_[g + 1] == first_[g]) share[g] = NAN;
    if (!two_bodies_.known()) share[two] = NAN;
    std::size_t most = t2;
    for (std::size_t s = 0; s < groups; ++s)
      if (share[s] > share[most]) most = s;
    OutOfDistributionScore s{share[most], share[two], {}, {}};
    if (share[two] > share[most]) most = two;
    const std::array beyond{m.empty > 0 && share_with_body_ > nearly_all_records,
                            m.clicks_per_pulse > std::max(record::max_clicks_per_pulse,
                                                          clicks_reserve * max_clicks_per_start_),
                            m.range_m < nearest_m_ || m.range_m > farthest_m_};
    const auto first = static_cast<std::size_t>(std::ranges::find(beyond, true) - beyond.begin());
    // T^2 has the name of the group that contributes most to it.
    const std::size_t flag = first < beyond.size() ? run_numbers + first
                             : share[most] > 1
                                 ? first_learnt + (most == t2 ? m.distances.group : most)
                                 : record_number_count;
    if (flag < record_number_count) {
      const RecordNumber& number = record_numbers[flag];
      s.reason = number.name;
      if (number.unit) s.details = format("%.2f%s", number.of(m), number.unit);
    }
    out.push_back(std::move(s));
  }
  return out;
}

void OutOfDistributionDetector::archive(Archive archive, const Features& of_model,
                                        const Alignment& alignment) {
  use(of_model, alignment);
  distances_.archive(archive, first_[groups]);
  Archive of_two = archive.in("two_bodies");
  if (of_two.part("known", two_bodies_.known())) two_bodies_.archive(of_two, first_[profile]);
  limits_.archive(archive, numbers);
  archive.number("nearest_m", nearest_m_, -1e18, 1e18);
  archive.number("farthest_m", farthest_m_, -1e18, 1e18);
  archive.number("most_clicks_per_start", max_clicks_per_start_, 0, 1e18);
  archive.number("share_with_body", share_with_body_, 0, 1);
}

}  // namespace echofuse::recon

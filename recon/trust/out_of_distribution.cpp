// SPDX-License-Identifier: MIT
#include "recon/trust/out_of_distribution.hpp"

#include <Eigen/Core>
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
#include "recon/trust/record_numbers.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t held_stream = 0x68656c64;  // "held" in ASCII
constexpr std::size_t max_components = 36, rows_a_component = 60;
// Number of folds if there are fewer than `many_records` records, and if there are more. The limits
// of T^2 and Q are set by all folds, because the tail of one fold has too few records. The
// detection of two bodies is slow to train; if there are at least `few_records` records, its limit
// is set by the last fold only.
constexpr std::size_t folds_of_few = 4, folds_of_many = 10;
constexpr std::size_t few_records = 400, many_records = 3000;
// Allowed false alarm rate of T^2, of the detection of two bodies, and of the Q statistics of all
// groups together.
constexpr double above_limit = 0.002;
constexpr double no_body_log_odds = -30;  // log odds of two bodies if a record shows no body
// Margin of the range limits, as a fraction of the training span.
constexpr double range_reserve = 0.05;
// A record can be saturated only if its clicks per pulse exceed this factor times the maximum in
// training.
constexpr double clicks_reserve = 1.25;
// A record without a body is unusual if more than this fraction of the training records show a
// body.
constexpr double nearly_all_records = 0.99;

// Reason that is reported if a group of values is unusual.
constexpr std::array unusual{"unusual histogram",
                             "unusual radar profile",
                             "unusual samples of the radar's antennas",
                             "unusual samples of the radar's antennas",
                             "unusual range",
                             "unusual radar profile"};

// Returns the rows in random order, because records of the same run or kind are contiguous.
Rows shuffled(std::size_t rows, Rng& rng) {
  Rows out = all_rows(rows);
  std::shuffle(out.begin(), out.end(), rng);
  return out;
}

// Returns the rows of `part` that show a body, or all rows of `part` if only a few show a body.
Rows usual_rows(Rows part, const Rows& with_body) {
  std::sort(part.begin(), part.end());
  Rows out;
  std::ranges::set_intersection(part, with_body, std::back_inserter(out));
  return out.size() < OutOfDistributionDetector::min_records / 2 ? part : out;
}

}  // namespace

void OutOfDistributionDetector::use(const Features& sensors, const Alignment& alignment) {
  std::array<std::size_t, groups> sizes{};
  if (sensors.spd_count() > 0) {
    const std::size_t array = alignment.array_features();
    sizes[histogram] = alignment.histogram_bins() + alignment.zone_features();
    sizes[radar] = alignment.profile_points();
    sizes[direction] = std::min(array, ArrayView::of_direction);
    sizes[spread] = array - sizes[direction], sizes[range] = 1;
  }
  sizes[profile] = sensors.radar_count();
  for (std::size_t g = 0; g < groups; ++g) first_[g + 1] = first_[g] + sizes[g];
}

bool OutOfDistributionDetector::shows_body(std::span<const float> description) const {
  return first_[range + 1] == 0 || description[first_[range]] != 0;
}

Rows OutOfDistributionDetector::learn_ranges(const Matrix& descriptions) {
  Rows out;
  for (std::size_t i = 0; i < descriptions.rows; ++i) {
    if (!shows_body(descriptions.row(i))) continue;
    // If the SPD is missing, this value is not a range, and the range limits are not used.
    const auto range_m = double{descriptions.row(i)[first_[range]]};
    nearest_m_ = out.empty() ? range_m : std::min(nearest_m_, range_m);
    farthest_m_ = out.empty() ? range_m : std::max(farthest_m_, range_m);
    out.push_back(i);
  }
  const double reserve_m = range_reserve * (farthest_m_ - nearest_m_);
  nearest_m_ -= reserve_m, farthest_m_ += reserve_m;
  return out;
}

Matrix OutOfDistributionDetector::describe_all(const Dataset& data, const Features& sensors,
                                               const Alignment& alignment) const {
  const Rows rows = all_rows(data.size());
  const Matrix views = sensors.spd_count() > 0 ? align(observe(data, rows, sensors), alignment)
                                               : Matrix(rows.size(), 0);
  Matrix out(0, first_[groups]);
  for (const std::size_t i : rows) out.add_row(describe(views.row(i), data, i));
  return out;
}

OutOfDistributionDetector::OutOfDistributionDetector(const Alignment& alignment,
                                                     const Dataset& data, const Matrix& views,
                                                     const Rows& rows, Inputs inputs,
                                                     const SceneModel& scene, std::uint64_t seed) {
  const Features sensors = fit_features(
      data, rows, alignment.array_features() > 0 ? inputs : without_antennas(inputs), raw_scaling);
  use(sensors, alignment);
  Matrix all(0, first_[groups]);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    all.add_row(describe(views.row(rows[i]), data, rows[i]));
    max_clicks_per_start_ = std::max(max_clicks_per_start_, data.records[rows[i]].clicks_per_pulse);
  }
  const Rows with_body = learn_ranges(all);
  share_with_body_ = static_cast<double>(with_body.size()) / static_cast<double>(rows.size());
  // Records labelled as two people must not define what a single body looks like.
  const auto shows_two = [&](std::size_t i) {
    return data.records[rows[i]].label == two_people_label;
  };
  const auto learn = [&](const Rows& part, bool with_two_bodies) {
    Rows usual = usual_rows(part, with_body);
    learn_components(take_rows(all, usual), seed);
    std::erase_if(usual, shows_two);
    for (std::size_t& i : usual) i = rows[i];
    if (with_two_bodies)
      two_bodies_ = learn_two_bodies(alignment, sensors, data, usual, scene, seed);
  };
  Rng rng = make_rng(seed, held_stream);
  const Rows order = shuffled(rows.size(), rng);
  const bool few = rows.size() < few_records;
  const bool has_spd = sensors.spd_count() > 0;
  const std::size_t parts = rows.size() < many_records ? folds_of_few : folds_of_many;
  std::vector<StatisticValues> held;
  std::vector<bool> without_two;  // records that do not set the limit of two bodies
  const WiderRadars wider(data, rows, inputs);
  std::vector<std::vector<StatisticValues>> held_converted(wider.size());
  for (std::size_t part = 0; part < parts; ++part) {
    const Split fold = make_fold(order, part, parts, 0);
    const bool learns_two = few || part + 1 == parts;
    learn(fold.train, has_spd && learns_two);
    for (const std::size_t i : fold.test)
      held.push_back(find(all.row(i))), without_two.push_back(!learns_two || shows_two(i));
    for (std::size_t k = 0; k < wider.size(); ++k) {
      Rows some;
      for (const std::size_t i : fold.test) some.push_back(rows[i]);
      const Matrix converted = describe_all(wider.imitated(k, data, some, rng), sensors, alignment);
      for (std::size_t i = 0; i < converted.rows; ++i)
        held_converted[k].push_back(find(converted.row(i)));
    }
  }
  if (few) learn(order, has_spd);
  limits_ = limits_of(held, without_two);
  for (std::size_t k = 0; k < wider.size(); ++k)
    converted_.push_back({wider.times_wider(k), limits_of(held_converted[k], without_two)});
}

std::vector<float> OutOfDistributionDetector::describe(std::span<const float> view,
                                                       const Dataset& data, std::size_t row) const {
  std::vector<float> out(first_[groups]);
  std::ranges::copy(view.last(first_[range + 1]), out.begin());
  const auto whole = std::span(out).subspan(first_[profile]);
  if (whole.empty()) return out;
  const auto power = beyond_leakage(data.radar(), row);
  std::ranges::copy(power, whole.last(power.size()).begin());
  normalise(whole);
  return out;
}

// Learns the principal components of the descriptions, scaled so that each group has the same total
// variance.
void OutOfDistributionDetector::learn_components(const Matrix& descriptions, std::uint64_t seed) {
  const auto variance = column_statistics(descriptions, all_rows(descriptions.rows)).variance;
  scale_.clear();
  for (std::size_t g = 0; g < groups; ++g) {
    double sum = 0;
    for (std::size_t c = first_[g]; c < first_[g + 1]; ++c) sum += variance[c];
    scale_.resize(first_[g + 1], sum > 0 ? static_cast<float>(1 / std::sqrt(sum)) : 0.f);
  }
  Matrix scaled = descriptions;
  for (std::size_t i = 0; i < scaled.values.size(); ++i)
    scaled.values[i] *= scale_[i % scaled.cols];
  const std::size_t count =
      std::clamp<std::size_t>(scaled.rows / rows_a_component, 2, max_components);
  components_ = principal_components(std::move(scaled), count, seed);
  for (float& d : components_.deviation) d = std::max(d, 1e-6f);
}

OutOfDistributionDetector::StatisticValues OutOfDistributionDetector::find(
    std::span<const float> description) const {
  constexpr double tiny = 1e-12;
  using Eigen::Map, Eigen::VectorXf, Eigen::Index;
  using Basis = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto vector = [](std::span<const float> v) {
    return Map<const VectorXf>(v.data(), std::ssize(v));
  };
  const Map<const Basis> basis(components_.basis.values.data(), Index(components_.basis.rows),
                               Index(components_.basis.cols));
  const VectorXf from_mean =
      vector(description).cwiseProduct(vector(scale_)) - vector(components_.mean);
  const VectorXf amounts = basis * from_mean;
  const VectorXf off = from_mean - basis.transpose() * amounts;
  // T^2 = sum over the components of (amount / deviation)^2. The group that contributes most to
  // this sum gives the reason.
  const auto variance = vector(components_.deviation).array().square();
  const VectorXf weights = basis.transpose() * (amounts.array() / variance).matrix();
  StatisticValues out{{}, histogram};
  double sum = 0, largest = -INFINITY;
  for (std::size_t g = 0; g < groups; ++g) {
    const auto first = Index(first_[g]), count = Index(first_[g + 1]) - first;
    const auto along = double{weights.segment(first, count).dot(from_mean.segment(first, count))};
    sum += along;
    if (along > largest) largest = along, out.along = static_cast<Group>(g);
    out.values[g] = std::log(double{off.segment(first, count).squaredNorm()} + tiny);
  }
  out.values[t2] = std::log(std::max(sum, 0.0) + tiny);
  out.values[two] = two_bodies_.known() && shows_body(description)
                        ? two_bodies_(description.first(first_[range + 1]))
                        : no_body_log_odds;
  return out;
}

OutOfDistributionDetector::Limits OutOfDistributionDetector::limits_of(
    const std::vector<StatisticValues>& held, const std::vector<bool>& without_two) {
  Limits out;
  for (std::size_t s = 0; s < statistics; ++s) {
    std::vector<float> values;
    for (std::size_t i = 0; i < held.size(); ++i)
      if (s != two || !without_two[i]) values.push_back(static_cast<float>(held[i].values[s]));
    if (values.empty()) continue;  // empty if all records show two people
    const double usual = double{quantile(values, 0.5)};
    const double above = above_limit / (s < groups ? static_cast<double>(groups) : 1.);
    out[s] = {usual, std::max(upper_limit(std::move(values), above), usual + 1e-6)};
  }
  return out;
}

OutOfDistributionDetector::Limits OutOfDistributionDetector::limits_for(double times_wider) const {
  Limits out = limits_;
  double from = 1;
  for (const LimitsAtWidth& next : converted_) {
    const double t = std::clamp((times_wider - from) / (next.times_wider - from), 0., 1.);
    for (std::size_t s = 0; s < statistics; ++s)
      out[s] = {std::lerp(out[s].usual, next.limits[s].usual, t),
                std::lerp(out[s].limit, next.limits[s].limit, t)};
    from = next.times_wider;
  }
  return out;
}

std::vector<OutOfDistributionScore> OutOfDistributionDetector::score(const Matrix& views,
                                                                     const Dataset& data,
                                                                     const Rows& rows) const {
  const bool has_spd = first_[range + 1] > 0;
  std::vector<OutOfDistributionScore> out;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto description = describe(views.row(i), data, rows[i]);
    const StatisticValues found = find(description);
    const Limits limits = limits_for(times_wider(data, rows[i]));
    OutOfDistributionScore s{limits[t2].share(found.values[t2]),
                             two_bodies_.known() ? limits[two].share(found.values[two]) : NAN,
                             {},
                             {}};
    Group group = found.along;
    for (std::size_t g = 0; g < groups; ++g)
      if (const double q = limits[g].share(found.values[g]);
          first_[g + 1] > first_[g] && q > s.distance)
        s.distance = q, group = static_cast<Group>(g);
    const bool has_range = has_spd && shows_body(description);
    const double range_m = has_range ? double{description[first_[range]]} : 0;
    const double clicks = data.records[rows[i]].clicks_per_pulse;
    if (has_spd && !has_range && share_with_body_ > nearly_all_records)
      s.reason = "empty";
    else if (has_spd && clicks > record::max_clicks_per_pulse &&
             clicks > clicks_reserve * max_clicks_per_start_)
      s.reason = "saturated", s.details = format("%.2f clicks per laser pulse", clicks);
    else if (has_range && (range_m < nearest_m_ || range_m > farthest_m_))
      s.reason = "outside the training records' distances", s.details = format("%.2f m", range_m);
    else if (s.two_bodies > 1 && s.two_bodies > s.distance)
      s.reason = "two bodies, or one unlike the training records'";
    else if (s.distance > 1)
      s.reason = unusual[group];
    out.push_back(std::move(s));
  }
  return out;
}

void OutOfDistributionDetector::archive(Archive archive, Limits& limits) {
  std::vector<double> values;
  for (const Limit& l : limits) values.push_back(l.usual), values.push_back(l.limit);
  archive.values("limits", values, 2 * statistics);
  for (std::size_t s = 0; s < statistics; ++s) {
    limits[s] = {values[2 * s], values[2 * s + 1]};
    archive.require(limits[s].limit >= limits[s].usual, "limits",
                    "expected a limit above the median");
  }
}

void OutOfDistributionDetector::archive(Archive archive, const Features& of_model,
                                        const Alignment& alignment) {
  use(of_model, alignment);
  const std::size_t values = first_[groups];
  archive.values("scale", scale_, values);
  recon::archive(archive.in("components"), components_, values);
  archive.require(std::ranges::all_of(components_.deviation, [](float d) { return d > 0; }),
                  "components/deviation", "expected positive values");
  Archive of_two = archive.in("two_bodies");
  if (of_two.part("known", two_bodies_.known())) two_bodies_.archive(of_two, first_[range + 1]);
  OutOfDistributionDetector::archive(archive, limits_);
  std::size_t converted = converted_.size();
  archive.count("brought", converted, 0, 16);
  converted_.resize(converted);
  double narrower = 1;
  for (std::size_t k = 0; k < converted; ++k) {
    Archive one = archive.in("brought_" + std::to_string(k));
    double& times_wider = converted_[k].times_wider;
    one.number("times_wider", times_wider, 1, 1e3);
    archive.require(times_wider > narrower, "times_wider", "expected ascending values above 1");
    narrower = times_wider;
    OutOfDistributionDetector::archive(one, converted_[k].limits);
  }
  archive.number("nearest_m", nearest_m_, -1e18, 1e18);
  archive.number("farthest_m", farthest_m_, -1e18, 1e18);
  archive.number("most_clicks_per_start", max_clicks_per_start_, 0, 1e18);
  archive.number("share_with_body", share_with_body_, 0, 1);
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include "recon/trust/out_of_distribution.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <random>

#include "drivers/core/clones.hpp"
#include "drivers/core/random.hpp"
#include "recon/data/split.hpp"
#include "recon/files/text.hpp"
#include "recon/maps/people.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t held_stream = 0x68656c64;  // "held"
constexpr std::size_t most_components = 36, rows_a_component = 60;
constexpr std::size_t folds_of_few = 4, folds_of_many = 10;  // one of which sets the limits
constexpr std::size_t few_records = 400, many_records = 3000;
// Of records like the training ones, above each limit.
constexpr std::array<double, 3> false_alarms = {0.002, 0.002, 0.003};
constexpr std::size_t of_two = 2;            // of the statistics
constexpr double range_reserve = 0.05;       // of the span of the training records' ranges
constexpr double clicks_reserve = 1.25;      // against the brightest training record
constexpr double nearly_all_records = 0.99;  // of the training records show a body

// Those of the rows that show a body, in order, if these are enough; `with_body` is sorted.
Rows with_bodies(Rows rows, const Rows& with_body) {
  std::sort(rows.begin(), rows.end());
  Rows out;
  std::set_intersection(rows.begin(), rows.end(), with_body.begin(), with_body.end(),
                        std::back_inserter(out));
  return out.size() >= OutOfDistributionDetector::least_records / 2 ? out : rows;
}

// By the sensor of the greatest residual.
const char* unusual(std::ptrdiff_t sensor) {
  constexpr std::array names{"unusual histogram", "unusual radar profile",
                             "unusual samples of the radar's antennas"};
  return names[static_cast<std::size_t>(sensor)];
}

// The part of `off` along a direction of length 1, which is taken away. Sums side by side: each
// addition to one alone waits for the last.
ECHOFUSE_CLONES float take_along(const float* direction, float* off, std::size_t count) {
  constexpr std::size_t at_once = 2 * lanes;
  Eight first{}, second{}, a, b;
  std::size_t c = 0;
  for (; c + at_once <= count; c += at_once) {
    echofuse::load(a, off + c), echofuse::load(b, direction + c);
    first += a * b;
    echofuse::load(a, off + c + lanes), echofuse::load(b, direction + c + lanes);
    second += a * b;
  }
  first += second;
  float amount = 0;
  for (std::size_t k = 0; k < lanes; ++k) amount += first[k];
  for (; c < count; ++c) amount += off[c] * direction[c];
  for (c = 0; c < count; ++c) off[c] -= amount * direction[c];
  return amount;
}

}  // namespace

void OutOfDistributionDetector::use(const Features& of_model, const Alignment& alignment) {
  raw_ = of_model, two_bodies_.use(of_model, alignment);
  profile_ = of_model.radar_count(), spd_bins_ = of_model.spd_count();
  if (spd_bins_ == 0) return;
  histogram_bins_ = alignment.histogram_bins(), array_ = alignment.array_features();
  aligned_ = alignment.size();
}

OutOfDistributionDetector::OutOfDistributionDetector(const Alignment& alignment,
                                                     const Dataset& data, const Matrix& aligned,
                                                     const Rows& rows, Inputs inputs,
                                                     const Scene& scene, std::uint64_t seed) {
  const bool by_array = alignment.array_features() > 0;
  const Features raw =
      fit_features(data, rows, by_array ? inputs : without_antennas(inputs), raw_scaling);
  use(raw, alignment);
  const Matrix raw_inputs = raw.raw_inputs(data, rows);
  // Shuffled, as runs and kinds of records lie behind each other.
  Rows order = all_rows(rows.size());
  Rng rng = make_rng(seed, held_stream);
  std::shuffle(order.begin(), order.end(), rng);
  Rows with_body;
  Matrix all;
  std::vector<std::optional<Place>> places;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto features = features_of(aligned.row(rows[i]));
    const auto one = describe(features, raw_inputs.row(i).subspan(spd_bins_, profile_));
    all.cols = one.size();
    all.add_row(one);
    if (aligned_ == 0 || shows_body(features)) with_body.push_back(i);
    places.push_back(place_of(data.depth.row(rows[i]), scene.background, scene.grid));
  }
  share_with_body_ = static_cast<double>(with_body.size()) / static_cast<double>(rows.size());
  for (const std::size_t row : rows)
    most_clicks_per_start_ = std::max(most_clicks_per_start_, data.clicks_a_pulse[row]);
  // Of so few records none is spared for the limits alone: each is judged by what the others say.
  const bool few = rows.size() < few_records;
  const std::size_t parts = few || rows.size() < many_records ? folds_of_few : folds_of_many;
  // Records that are said to show two do not tell what is usual of one.
  const auto shows_two = [&](std::size_t i) { return data.label[rows[i]] == two_people_label; };
  const auto learn_one = [&](const Rows& part) { learn(all, with_bodies(part, with_body), seed); };
  const auto learn_two = [&](const Rows& part) {
    Rows usual = with_bodies(part, with_body);
    std::erase_if(usual, shows_two);
    two_bodies_.learn(raw_inputs, usual, places, seed);
  };
  std::array<std::vector<float>, 6> held_statistics;
  for (std::size_t part = few ? 0 : parts - 1; part < parts; ++part) {
    const Split fold = make_fold(order, part, parts, 0);
    learn_one(fold.train);
    // The classifier costs most by far: of few records it learns one half, and judges both parts of
    // the other.
    if (!few)
      learn_two(fold.train);
    else if (part % 2 == 0)
      learn_two(make_fold(order, part / 2, parts / 2, 0).train);
    for (const std::size_t i : fold.test) {
      std::vector<float> one(all.row(i).begin(), all.row(i).end());
      for (std::size_t c = 0; c < one.size(); ++c) one[c] *= scale_[c];
      const auto found = statistics(one, raw_inputs.row(i));
      for (std::size_t s = 0; s < found.size(); ++s)
        if (s != of_two || !shows_two(i))
          held_statistics[s].push_back(static_cast<float>(found[s]));
    }
  }
  if (few) learn_one(order), learn_two(order);
  set_limits(std::move(held_statistics));
  if (inputs == Inputs::radar || with_body.empty()) return;
  const std::size_t at = aligned_ - 1;
  nearest_m_ = 1e9;
  for (const std::size_t i : with_body) {
    nearest_m_ = std::min(nearest_m_, double{all.row(i)[at]});
    farthest_m_ = std::max(farthest_m_, double{all.row(i)[at]});
  }
  const double reserve_m = range_reserve * (farthest_m_ - nearest_m_);
  nearest_m_ -= reserve_m, farthest_m_ += reserve_m;
}

void OutOfDistributionDetector::learn(const Matrix& descriptions, const Rows& rows,
                                      std::uint64_t seed) {
  scale_.clear();
  learn_scale(take_rows(descriptions, rows));
  Matrix one_body = take_rows(descriptions, rows);
  for (std::size_t i = 0; i < one_body.values.size(); ++i)
    one_body.values[i] *= scale_[i % one_body.cols];
  const std::size_t count =
      std::clamp<std::size_t>(rows.size() / rows_a_component, 2, most_components);
  components_ = principal_components(one_body, count, seed);
  for (float& d : components_.deviation) d = std::max(d, 1e-6f);
}

std::vector<float> OutOfDistributionDetector::describe(std::span<const float> aligned,
                                                       std::span<const float> radar) const {
  std::vector<float> out;
  if (aligned_ > 0) {
    const auto sensors = aligned.first(aligned_ - 1);
    out.assign(sensors.begin(), sensors.end());
    out.push_back(aligned.back());
  }
  out.insert(out.end(), radar.begin(), radar.end());
  normalise(std::span(out).last(radar.size()));
  for (std::size_t c = 0; c < scale_.size(); ++c) out[c] *= scale_[c];
  return out;
}

// Histogram, aligned profile, direction and spread in the antennas' view, range and profile get the
// same total variance.
void OutOfDistributionDetector::learn_scale(const Matrix& descriptions) {
  const auto variance = column_statistics(descriptions, all_rows(descriptions.rows)).variance;
  std::vector<std::size_t> ends;
  if (aligned_ > 0) {
    const std::size_t range_at = aligned_ - 1, array_at = range_at - array_;
    ends = {histogram_bins_, array_at};
    if (array_ > 0) ends.insert(ends.end(), {array_at + ArrayView::of_direction, range_at});
    ends.push_back(aligned_);
  }
  ends.push_back(descriptions.cols);
  std::size_t first = 0;
  for (const std::size_t end : ends) {
    double sum = 0;
    for (std::size_t c = first; c < end; ++c) sum += variance[c];
    scale_.resize(end, sum > 0 ? static_cast<float>(1 / std::sqrt(sum)) : 0.f);
    first = end;
  }
}

OutOfDistributionDetector::Statistics OutOfDistributionDetector::statistics(
    std::span<const float> description, std::span<const float> raw_inputs) const {
  constexpr double tiny = 1e-12;
  std::vector<float> off(description.begin(), description.end()), amounts(components_.basis.rows);
  for (std::size_t c = 0; c < off.size(); ++c) off[c] -= components_.mean[c];
  double along = 0;
  for (std::size_t k = 0; k < amounts.size(); ++k) {
    const float amount = take_along(components_.basis.row(k).data(), off.data(), off.size());
    amounts[k] = amount / components_.deviation[k];
    along += double{amounts[k]} * double{amounts[k]};
  }
  std::array<double, 3> residual{};
  const std::size_t range_at = aligned_ > 0 ? aligned_ - 1 : off.size();
  const std::size_t array_at = range_at - array_;
  for (std::size_t c = 0; c < off.size(); ++c) {
    const bool radar = aligned_ == 0 || (c >= histogram_bins_ && c != range_at);
    residual[radar && c >= array_at && c < range_at ? 2 : std::size_t{radar}] +=
        double{off[c]} * double{off[c]};
  }
  return {
      std::log(along + tiny),           std::log(residual[0] + residual[1] + residual[2] + tiny),
      two_bodies_(raw_inputs),          residual[0] / usual_residual_[0],
      residual[1] / usual_residual_[1], residual[2] / usual_residual_[2]};
}

void OutOfDistributionDetector::set_limits(std::array<std::vector<float>, 6> all) {
  for (std::size_t s = 0; s < limits_.size(); ++s) {
    if (all[s].empty()) continue;  // of records of two alone
    limits_[s].usual = double{quantile(all[s], 0.5)};
    limits_[s].most = std::max(upper_limit(all[s], false_alarms[s]), limits_[s].usual + 1e-6);
  }
  for (std::size_t s = 0; s < usual_residual_.size(); ++s)
    usual_residual_[s] = std::max(double{quantile(all[limits_.size() + s], 0.5)}, 1e-12);
}

std::vector<OutOfDistributionScore> OutOfDistributionDetector::judge(const Matrix& aligned,
                                                                     const Dataset& data,
                                                                     const Rows& rows) const {
  const bool spd = aligned_ > 0;
  const Matrix raw_inputs = raw_.raw_inputs(data, rows);
  std::vector<OutOfDistributionScore> out;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto features = features_of(aligned.row(i));
    const auto raw = raw_inputs.row(i);
    const auto found = statistics(describe(features, raw.subspan(spd_bins_, profile_)), raw);
    OutOfDistributionScore s{std::max(limits_[0].share(found[0]), limits_[1].share(found[1])),
                             two_bodies_.known() ? limits_[of_two].share(found[of_two]) : NAN,
                             {},
                             {}};
    const bool has_range = spd && shows_body(features);
    const double range_m = has_range ? double{features.back()} : 0;
    const double clicks = data.clicks_a_pulse[rows[i]];
    if (spd && !has_range && share_with_body_ > nearly_all_records)
      s.reason = "empty";
    else if (spd && clicks > record::most_clicks_a_pulse &&
             clicks > clicks_reserve * most_clicks_per_start_)
      s.reason = "saturated", s.details = formatted("%.2f clicks a laser pulse", clicks);
    else if (has_range && (range_m < nearest_m_ || range_m > farthest_m_))
      s.reason = "outside the training records' distances",
      s.details = formatted("%.2f m", range_m);
    s.may_be_two = s.reason.empty() && s.two_bodies > 1;
    if (s.may_be_two && s.two_bodies > s.distance)
      s.reason = "two bodies, or one unlike the training records'";
    else if (s.reason.empty() && s.distance > 1)
      s.reason = unusual(std::max_element(found.begin() + 3, found.end()) - found.begin() - 3);
    out.push_back(std::move(s));
  }
  return out;
}

void OutOfDistributionDetector::archive(Archive archive, const Features& of_model,
                                        const Alignment& alignment) {
  use(of_model, alignment);
  const std::size_t values = aligned_ + profile_;
  archive.values("scale", scale_, values);
  recon::archive(archive.in("components"), components_, values);
  const auto above_0 = [](const auto& all) {
    return std::all_of(all.begin(), all.end(), [](auto v) { return v > 0; });
  };
  archive.require(above_0(components_.deviation), "components/deviation", "expected all above 0");
  two_bodies_.archive(archive.in("two_bodies"));
  std::vector<double> limits;
  for (const Limit& l : limits_) limits.push_back(l.usual), limits.push_back(l.most);
  for (const double usual : usual_residual_) limits.push_back(usual);
  archive.values("limits", limits, 2 * limits_.size() + usual_residual_.size());
  for (std::size_t s = 0; s < limits_.size(); ++s) {
    limits_[s] = {limits[2 * s], limits[2 * s + 1]};
    archive.require(limits_[s].most >= limits_[s].usual, "limits", "expected none below the usual");
  }
  std::copy_n(limits.end() - std::ssize(usual_residual_), usual_residual_.size(),
              usual_residual_.begin());
  archive.require(above_0(usual_residual_), "limits", "expected usual residuals above 0");
  archive.number("nearest_m", nearest_m_, -1e18, 1e18);
  archive.number("farthest_m", farthest_m_, -1e18, 1e18);
  archive.number("most_clicks_per_start", most_clicks_per_start_, 0, 1e18);
  archive.number("share_with_body", share_with_body_, 0, 1);
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include "recon/trust/out_of_distribution.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <random>

#include "drivers/core/random.hpp"
#include "recon/data/split.hpp"
#include "recon/metrics/people.hpp"
#include "recon/numbers/statistics.hpp"
#include "recon/numbers/text.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t held_stream = 0x68656c64;  // "held"
constexpr std::size_t most_components = 36, rows_a_component = 60;
constexpr std::size_t folds_of_few = 4, folds_of_many = 10;  // one fold sets the limits
constexpr std::size_t few_records = 400, many_records = 3000;
// These are the shares of records like the training ones that lie above each limit. The groups
// share that of Q.
constexpr double above_t2 = 0.002, above_q = 0.002, above_two = 0.002;
constexpr double not_known = -1e9;           // the training lacks these numbers
constexpr double range_reserve = 0.05;       // share of the span of the training records' ranges
constexpr double clicks_reserve = 1.25;      // factor of the brightest training record's clicks
constexpr double nearly_all_records = 0.99;  // share of the training records that show a body

// The reason names the group that stands out.
constexpr std::array unusual{"unusual histogram",
                             "unusual radar profile",
                             "unusual samples of the radar's antennas",
                             "unusual samples of the radar's antennas",
                             "unusual range",
                             "unusual radar profile",
                             "unusual variation of the radar's power"};

// Returns the rows that show a body, in order, or all of the rows if those are too few; `with_body`
// is sorted.
Rows with_bodies(Rows rows, const Rows& with_body) {
  std::sort(rows.begin(), rows.end());
  Rows out;
  std::set_intersection(rows.begin(), rows.end(), with_body.begin(), with_body.end(),
                        std::back_inserter(out));
  return out.size() >= OutOfDistributionDetector::least_records / 2 ? out : rows;
}

}  // namespace

void OutOfDistributionDetector::use(const Features& of_model, const Alignment& alignment) {
  raw_ = of_model, two_bodies_.use(of_model, alignment);
  profile_ = of_model.radar_count(), spd_bins_ = of_model.spd_count();
  std::array<std::size_t, groups> sizes{};
  if (spd_bins_ > 0) {
    aligned_ = alignment.size();
    const std::size_t array = alignment.array_features();
    sizes[histogram] = alignment.histogram_bins(), sizes[radar] = alignment.profile_points();
    sizes[direction] = std::min(array, ArrayView::of_direction);
    sizes[spread] = array - sizes[direction], sizes[range] = 1;
  }
  sizes[profile] = profile_, sizes[power] = profile_ > 0 ? power_variations : 0;
  for (std::size_t g = 0; g < groups; ++g) first_[g + 1] = first_[g] + sizes[g];
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
  // The rows are shuffled, as runs and kinds of records lie behind each other.
  Rows order = all_rows(rows.size());
  Rng rng = make_rng(seed, held_stream);
  std::shuffle(order.begin(), order.end(), rng);
  learn_usual_power(data, rows);
  Rows with_body;
  Matrix all;
  std::vector<std::optional<Place>> places;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto features = features_of(aligned.row(rows[i]));
    const auto one = describe(features, power_of(raw_inputs.row(i)), data.speckle[rows[i]]);
    all.cols = one.size();
    all.add_row(one);
    if (aligned_ == 0 || shows_body(features)) with_body.push_back(i);
    places.push_back(place_of(data.depth.row(rows[i]), scene.background, scene.grid));
  }
  share_with_body_ = static_cast<double>(with_body.size()) / static_cast<double>(rows.size());
  for (const std::size_t row : rows)
    most_clicks_per_start_ = std::max(most_clicks_per_start_, data.clicks_a_pulse[row]);
  // With so few records none is set aside for the limits alone: each is judged by what the others
  // teach.
  const bool few = rows.size() < few_records;
  const std::size_t parts = few || rows.size() < many_records ? folds_of_few : folds_of_many;
  // Records whose label says two people do not show what is usual for one.
  const auto shows_two = [&](std::size_t i) { return data.label[rows[i]] == two_people_label; };
  const auto learn_one = [&](const Rows& part) { learn(all, with_bodies(part, with_body), seed); };
  const auto learn_two = [&](const Rows& part) {
    Rows usual = with_bodies(part, with_body);
    std::erase_if(usual, shows_two);
    two_bodies_.learn(raw_inputs, usual, places, seed);
  };
  std::vector<Statistics> held;
  std::vector<bool> two;
  for (std::size_t part = few ? 0 : parts - 1; part < parts; ++part) {
    const Split fold = make_fold(order, part, parts, 0);
    learn_one(fold.train);
    // The classifier costs most by far: with few records it learns from one half, and judges both
    // parts of the other half.
    if (!few)
      learn_two(fold.train);
    else if (part % 2 == 0)
      learn_two(make_fold(order, part / 2, parts / 2, 0).train);
    for (const std::size_t i : fold.test) {
      std::vector<float> one(all.row(i).begin(), all.row(i).end());
      for (std::size_t c = 0; c < one.size(); ++c) one[c] *= scale_[c];
      held.push_back(
          statistics(one, features_of(aligned.row(rows[i])), power_of(raw_inputs.row(i)))),
          two.push_back(shows_two(i));
    }
  }
  if (few) learn_one(order), learn_two(order);
  set_limits(held, two);
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
  learn_scale(take_rows(descriptions, rows));
  Matrix one_body = take_rows(descriptions, rows);
  for (std::size_t i = 0; i < one_body.values.size(); ++i)
    one_body.values[i] *= scale_[i % one_body.cols];
  const std::size_t count =
      std::clamp<std::size_t>(rows.size() / rows_a_component, 2, most_components);
  components_ = principal_components(one_body, count, seed);
  for (float& d : components_.deviation) d = std::max(d, 1e-6f);
}

void OutOfDistributionDetector::learn_usual_power(const Dataset& data, const Rows& rows) {
  std::array<double, power_variations> sum{}, count{};
  for (const std::size_t row : rows) {
    const auto found = log_power_variations(data.speckle[row]);
    for (std::size_t k = 0; k < found.size(); ++k)
      if (!std::isnan(found[k])) sum[k] += found[k], ++count[k];
  }
  usual_power_.clear();
  for (std::size_t k = 0; k < sum.size(); ++k)
    usual_power_.push_back(2 * count[k] > static_cast<double>(rows.size()) ? sum[k] / count[k]
                                                                           : not_known);
}

// If the power's variation is not known, here or in the training, it counts as usual.
std::vector<float> OutOfDistributionDetector::describe(
    std::span<const float> aligned, std::span<const float> power_profile,
    const std::optional<record::Speckle>& speckle) const {
  std::vector<float> out(first_[groups]);
  std::copy(aligned.begin(), aligned.end(), out.begin());
  const auto whole = std::span(out).subspan(first_[profile], profile_);
  std::copy(power_profile.begin(), power_profile.end(), whole.begin());
  normalise(whole);
  const auto found = log_power_variations(speckle);
  for (std::size_t k = 0; first_[power] + k < out.size(); ++k)
    if (!std::isnan(found[k]) && usual_power_[k] != not_known)
      out[first_[power] + k] = static_cast<float>(found[k] - usual_power_[k]);
  for (std::size_t c = 0; c < scale_.size(); ++c) out[c] *= scale_[c];
  return out;
}

// Each group gets the same total variance.
void OutOfDistributionDetector::learn_scale(const Matrix& descriptions) {
  const auto variance = column_statistics(descriptions, all_rows(descriptions.rows)).variance;
  scale_.clear();
  for (std::size_t g = 0; g < groups; ++g) {
    double sum = 0;
    for (std::size_t c = first_[g]; c < first_[g + 1]; ++c) {
      const double floor = g == power ? power_variation_numbers[c - first_[g]].floor : 0;
      sum += std::max(variance[c], floor * floor);
    }
    scale_.resize(first_[g + 1], sum > 0 ? static_cast<float>(1 / std::sqrt(sum)) : 0.f);
  }
}

OutOfDistributionDetector::Statistics OutOfDistributionDetector::statistics(
    std::span<const float> description, std::span<const float> aligned,
    std::span<const float> power_profile) const {
  constexpr double tiny = 1e-12;
  using Eigen::Map, Eigen::VectorXf, Eigen::Index;
  using Basis = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto vector = [](std::span<const float> v) {
    return Map<const VectorXf>(v.data(), std::ssize(v));
  };
  const Map<const Basis> basis(components_.basis.values.data(), Index(components_.basis.rows),
                               Index(components_.basis.cols));
  const VectorXf from_mean = vector(description) - vector(components_.mean);
  const VectorXf amounts = basis * from_mean;
  const VectorXf off = from_mean - basis.transpose() * amounts;
  // T^2 = sum (amount / deviation)^2 is also the sum of what each value adds.
  const auto variance = vector(components_.deviation).array().square();
  const VectorXf weights = basis.transpose() * (amounts.array() / variance).matrix();
  Statistics out{};
  for (std::size_t g = 0; g < groups; ++g) {
    const auto first = Index(first_[g]), count = Index(first_[g + 1]) - first;
    out.along[g] = double{weights.segment(first, count).dot(from_mean.segment(first, count))};
    out.q[g] = std::log(double{off.segment(first, count).squaredNorm()} + tiny);
  }
  const double t2 = std::accumulate(out.along.begin(), out.along.end(), 0.0);
  out.t2 = std::log(std::max(t2, 0.0) + tiny), out.two_bodies = two_bodies_(aligned, power_profile);
  return out;
}

void OutOfDistributionDetector::set_limits(const std::vector<Statistics>& held,
                                           const std::vector<bool>& shows_two) {
  const auto limit = [](std::vector<float> values, double above) {
    if (values.empty()) return Limit{};  // all records are of two people
    const double usual = double{quantile(values, 0.5)};
    return Limit{usual, std::max(upper_limit(std::move(values), above), usual + 1e-6)};
  };
  std::vector<float> along, two;
  std::array<std::vector<float>, groups> off;
  for (std::size_t i = 0; i < held.size(); ++i) {
    along.push_back(static_cast<float>(held[i].t2));
    if (!shows_two[i]) two.push_back(static_cast<float>(held[i].two_bodies));
    for (std::size_t g = 0; g < groups; ++g) off[g].push_back(static_cast<float>(held[i].q[g]));
  }
  t2_ = limit(std::move(along), above_t2), two_ = limit(std::move(two), above_two);
  for (std::size_t g = 0; g < groups; ++g)
    q_[g] = limit(std::move(off[g]), above_q / static_cast<double>(q_.size()));
}

OutOfDistributionDetector::Distance OutOfDistributionDetector::distance(
    const Statistics& found) const {
  const auto most = std::max_element(found.along.begin(), found.along.end());
  Distance out{t2_.share(found.t2), static_cast<Group>(most - found.along.begin())};
  for (std::size_t g = 0; g < groups; ++g)
    if (const double share = q_[g].share(found.q[g]);
        first_[g + 1] > first_[g] && share > out.share)
      out = {share, static_cast<Group>(g)};
  return out;
}

// The text reads like "0.71 from frame to frame, 0.02 in training".
std::string OutOfDistributionDetector::power_text(
    const std::optional<record::Speckle>& speckle) const {
  constexpr std::array names{"from frame to frame", "from carrier to carrier", "within 150 ms"};
  const auto found = log_power_variations(speckle);
  std::string out;
  double most = 0;
  for (std::size_t k = 0; k < found.size(); ++k)
    if (const double off = std::abs(found[k] - usual_power_[k]);
        usual_power_[k] != not_known && off > most)
      most = off, out = formatted("%.2g %s, %.2g in training", power_variation(found[k], k),
                                  names[k], power_variation(usual_power_[k], k));
  return out;
}

std::vector<OutOfDistributionScore> OutOfDistributionDetector::judge(const Matrix& aligned,
                                                                     const Dataset& data,
                                                                     const Rows& rows) const {
  const bool spd = aligned_ > 0;
  const Matrix raw_inputs = raw_.raw_inputs(data, rows);
  std::vector<OutOfDistributionScore> out;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto features = features_of(aligned.row(i));
    const auto power_profile = power_of(raw_inputs.row(i));
    const std::optional<record::Speckle>& speckle = data.speckle[rows[i]];
    const auto found =
        statistics(describe(features, power_profile, speckle), features, power_profile);
    const auto [distance_share, group] = distance(found);
    OutOfDistributionScore s{
        distance_share, two_bodies_.known() ? two_.share(found.two_bodies) : NAN, {}, {}};
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
    else if (s.reason.empty() && s.distance > 1) {
      s.reason = unusual[group];
      if (group == power) s.details = power_text(speckle);
    }
    out.push_back(std::move(s));
  }
  return out;
}

void OutOfDistributionDetector::archive(Archive archive, const Features& of_model,
                                        const Alignment& alignment) {
  use(of_model, alignment);
  const std::size_t values = first_[groups];
  archive.values("usual_power", usual_power_, power_variations);
  archive.values("scale", scale_, values);
  recon::archive(archive.in("components"), components_, values);
  const auto above_0 = [](const auto& all) {
    return std::all_of(all.begin(), all.end(), [](auto v) { return v > 0; });
  };
  archive.require(above_0(components_.deviation), "components/deviation", "expected all above 0");
  two_bodies_.archive(archive.in("two_bodies"));
  std::vector<double> limits;
  std::vector<Limit*> all{&t2_, &two_};
  for (Limit& l : q_) all.push_back(&l);
  for (const Limit* l : all) limits.push_back(l->usual), limits.push_back(l->most);
  archive.values("limits", limits, 2 * all.size());
  for (std::size_t s = 0; s < all.size(); ++s) {
    *all[s] = {limits[2 * s], limits[2 * s + 1]};
    archive.require(all[s]->most >= all[s]->usual, "limits", "expected none below the usual");
  }
  archive.number("nearest_m", nearest_m_, -1e18, 1e18);
  archive.number("farthest_m", farthest_m_, -1e18, 1e18);
  archive.number("most_clicks_per_start", most_clicks_per_start_, 0, 1e18);
  archive.number("share_with_body", share_with_body_, 0, 1);
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include "recon/uncertainty/range_bias.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/core/random.hpp"
#include "recon/files/text.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t least_records = 50;
constexpr float longest_m = 100;         // no displacement is as long
constexpr double most_background = 0.1;  // share of the radar's power
constexpr double edge = 0.05;            // share of the records beyond it
constexpr int resamples = 200;
constexpr double significance = 4;           // standard errors
constexpr double least_range_bias_m = 0.01;  // less costs next to nothing
constexpr double least_seen_m = 0.03;        // if even this is not significant
constexpr double edges_agree_m = 0.015;      // on either side of their mean
// With antennas, of what is left of the displacements: a row of antennas that is mounted the other
// way round, 0.5 m beside the SPD, spreads it by decimetres.
constexpr double most_spread_m = 0.1, most_spread_growth = 1.8;
constexpr std::size_t window = 500, watch_every = 25;   // bodies
constexpr std::uint64_t bootstrap_stream = 0x736c6970;  // "range_bias"

struct Edges {
  double left_m, right_m;
};

Edges edges_of(std::vector<float> values) {
  return {double{quantile(values, edge)}, double{quantile(values, 1 - edge)}};
}

Edges operator-(const Edges& a, const Edges& b) {
  return {a.left_m - b.left_m, a.right_m - b.right_m};
}

struct Seen {
  Matrix histograms;  // aligned; the direction's cosine and its square, with antennas; their ranges
  Matrix displacements_m;
};

Seen see(const Alignment& alignment, const Matrix& aligned, const Rows& rows) {
  const std::size_t bins = alignment.histogram_bins();
  const bool by_angle = alignment.array_features() > 0;
  Seen out{Matrix(0, bins + (by_angle ? 3 : 1)), Matrix(0, 1)};
  for (const std::size_t row : rows) {
    const auto features = aligned.row(row);
    if (!shows_body(features)) continue;
    const auto displacement_m = static_cast<float>(alignment.displacement_m(features));
    out.displacements_m.add_row({&displacement_m, 1});
    std::vector<float> histogram(features.begin(), features.begin() + std::ptrdiff_t(bins));
    const auto cosine = static_cast<float>(by_angle ? alignment.direction_cosine(features) : 0);
    if (by_angle) histogram.insert(histogram.end(), {cosine, cosine * cosine});
    histogram.push_back(features.back());
    out.histograms.add_row(histogram);
  }
  return out;
}

Edges edges_of(const ResampledQuantiles& values) {
  return {double{values(edge)}, double{values(1 - edge)}};
}

// Of a run whose bodies moved alike; the standard error is known.
RangeBias::Status status_of(const RangeBias& found) {
  const double seen_m = significance * found.standard_error_m;
  return std::abs(found.bias_m) > std::max(least_range_bias_m, seen_m) ? RangeBias::Status::detected
         : seen_m > least_seen_m ? RangeBias::Status::too_few_records
                                 : RangeBias::Status::not_detected;
}

}  // namespace

RangeBiasAction range_bias_action_of(const std::string& name) {
  for (std::size_t i = 0; i < range_bias_action_names.size(); ++i)
    if (name == range_bias_action_names[i]) return static_cast<RangeBiasAction>(i);
  throw Error(ExitCode::usage, "range bias \"" + name + "\": expected warn, correct or ignore");
}

std::string RangeBias::text(bool corrected, bool other_shapes) const {
  switch (status) {
    case Status::too_few_records:
      if (records == 0) return {};
      if (by_echoes)
        return formatted(
            "%zu records show what stands still not well enough to tell whether the ranges have a "
            "bias (standard error %.1f cm)",
            records, standard_error_m * 100);
      return formatted(
                 "%zu records with a body, and those of the training, are too few to tell whether "
                 "the ranges have a bias",
                 records) +
             (standard_error_m > 0 ? formatted(" (standard error %.1f cm)", standard_error_m * 100)
                                   : "");
    case Status::not_detected:
      return {};
    case Status::inconsistent:
      if (by_angle)
        return "the radar's ranges do not follow the directions in which its antennas see the "
               "people as they did in training: are the antennas in another order, the other way "
               "round, or is the radar elsewhere?";
      return formatted(
          "cannot tell whether there is a range bias: against the SPD's, the radar's ranges of the "
          "leftmost bodies moved by %+.1f cm since training, of the rightmost by %+.1f cm; people "
          "or the radar stand elsewhere",
          left_m * 100, right_m * 100);
    case Status::detected:
      break;
  }
  using Says = RangeBiasEvidence::Says;
  const std::string found =
      formatted("radar ranges %.1f +- %.1f cm %s than in training, %s", std::abs(bias_m) * 100,
                standard_error_m * 100, bias_m > 0 ? "longer" : "shorter",
                by_echoes  ? "of what stands still"
                : by_angle ? "against the SPD's, wherever the radar's antennas see the people"
                           : "against the SPD's");
  const std::string moved = found + (evidence.text.empty() ? "" : " (" + evidence.text + ")");
  if (corrected) return moved + ": corrected";
  if (evidence.says == Says::no_range_bias) return moved + ": not corrected";
  if (by_echoes || evidence.says == Says::range_bias)
    return moved + ": not corrected (--range-bias correct does); calibrate anew";
  if (other_shapes)
    return moved + ": not corrected, as people or sensors are others, which may do that alone";
  if (by_angle)
    return moved +
           ": a range bias, or bodies that reflect the radar "
           "otherwise: not corrected (--range-bias correct does); calibrate anew";
  return moved +
         ": a range bias, or people further to one side, or bodies that reflect the radar "
         "otherwise: nothing in the records tells which, so not corrected; calibrate anew";
}

RangeBiasReference::RangeBiasReference(const Alignment& alignment, const Dataset& data,
                                       const Matrix& aligned, const Rows& rows)
    : echoes_(data, rows) {
  // In front of walls only if these are known: what is learnt of them among people keeps some of
  // them.
  if (!data.empty_room.known() &&
      alignment.radar_background_share(data.radar, rows) > most_background)
    return;
  const Seen seen = see(alignment, aligned, rows);
  if (seen.histograms.rows < least_records) return;
  by_angle_ = alignment.array_features() > 0;
  expected_ = make_ridge();
  const Samples samples{seen.histograms, seen.displacements_m, all_rows(seen.histograms.rows)};
  expected_->fit(samples, samples, {});
  displacements_m_ = less_expected(seen.histograms, seen.displacements_m);
}

std::vector<float> RangeBiasReference::measure(const Alignment& alignment, const Dataset& data,
                                               const Matrix& aligned) const {
  if (!knows_bodies()) return {};
  Rows rows;
  for (std::size_t row = 0; row < data.size(); ++row)
    if (data.fault_of(row, Inputs::fused).empty()) rows.push_back(row);
  const Seen seen = see(alignment, aligned, rows);
  return less_expected(seen.histograms, seen.displacements_m);
}

std::vector<float> RangeBiasReference::less_expected(const Matrix& histograms,
                                                     const Matrix& displacements_m) const {
  std::vector<float> out(displacements_m.values.begin(), displacements_m.values.end());
  if (out.empty()) return out;
  const Matrix expected = expected_->predict(histograms);
  for (std::size_t i = 0; i < expected.rows; ++i) out[i] -= expected.values[i];
  return out;
}

RangeBias RangeBiasReference::judge(std::vector<float> found) const {
  RangeBias out;
  out.records = found.size();
  if (std::min(found.size(), displacements_m_.size()) < least_records) return out;
  if (by_angle_) return judge_by_angle(found);
  const Edges moved = edges_of(found) - edges_of(displacements_m_);
  out.left_m = moved.left_m, out.right_m = moved.right_m;
  out.bias_m = (moved.left_m + moved.right_m) / 2;
  std::vector<double> middles, halves;
  Rng rng = make_rng(found.size(), bootstrap_stream);
  ResampledQuantiles now(found), then(displacements_m_);
  for (int i = 0; i < resamples; ++i) {
    now.draw(rng), then.draw(rng);
    const Edges e = edges_of(now) - edges_of(then);
    middles.push_back((e.left_m + e.right_m) / 2);
    halves.push_back((e.left_m - e.right_m) / 2);
  }
  out.standard_error_m = standard_deviation(middles);
  const double apart = std::abs(moved.left_m - moved.right_m) / 2;
  const double apart_error = standard_deviation(halves);
  out.status =
      apart > edges_agree_m + 2 * apart_error ? RangeBias::Status::inconsistent : status_of(out);
  return out;
}

RangeBias RangeBiasReference::judge(const Alignment& alignment, const Dataset& data,
                                    const Matrix& aligned, const GainCheck& gains) const {
  using Status = RangeBias::Status;
  RangeBias out;
  if (knows_bodies()) {
    out = judge(measure(alignment, data, aligned));
    if (out.status != Status::detected) return out;
  }
  const EchoMove echoes = echoes_.judge(data, aligned, out.bias_m >= 0);
  if (knows_bodies()) {
    double range_m = 0, bodies = 0;
    for (std::size_t i = 0; i < aligned.rows; ++i)
      if (shows_body(aligned.row(i))) range_m += double{aligned.row(i).back()}, ++bodies;
    out.evidence = weigh({out.bias_m, out.standard_error_m, range_m / bodies}, echoes, gains);
    const std::string age = calibration_age(data);
    out.evidence.text += (age.empty() || out.evidence.text.empty() ? "" : "; ") + age;
  } else if (echoes.seen) {
    out.by_echoes = true;
    out.records = echoes.records, out.bias_m = echoes.moved_m;
    out.standard_error_m = echoes.standard_error_m;
    out.status = status_of(out);
  }
  return out;
}

RangeBias RangeBiasReference::judge_by_angle(const std::vector<float>& found) const {
  RangeBias out;
  out.records = found.size(), out.by_angle = true;
  const auto median = [](std::vector<float> values) { return double{quantile(values, 0.5)}; };
  out.bias_m = median(found) - median(displacements_m_);
  std::vector<double> middles;
  Rng rng = make_rng(found.size(), bootstrap_stream);
  ResampledQuantiles now(found), then(displacements_m_);
  for (int i = 0; i < resamples; ++i) {
    now.draw(rng), then.draw(rng);
    middles.push_back(double{now(0.5)} - double{then(0.5)});
  }
  out.standard_error_m = standard_deviation(middles);
  const auto spread = [&](const std::vector<float>& values) {
    const Edges e = edges_of(values);
    return e.right_m - e.left_m;
  };
  const double usual_m = std::max(most_spread_m, most_spread_growth * spread(displacements_m_));
  out.status = spread(found) > usual_m ? RangeBias::Status::inconsistent : status_of(out);
  return out;
}

std::size_t RangeBiasReference::inputs(const Alignment& alignment) {
  return alignment.histogram_bins() + (alignment.array_features() > 0 ? 3 : 1);
}

void RangeBiasReference::save(record::H5File& file) const {
  if (!known()) return;
  record::H5File group = file.group("range_bias");
  echoes_.save(file);
  if (!knows_bodies()) return;
  expected_->save(group);
  file.write("range_bias/displacement_m", displacements_m_, {displacements_m_.size()});
}

void RangeBiasReference::load(const record::H5File& file, const Alignment& alignment) {
  if (!file.has("range_bias")) return;
  require_sound(file, alignment.known() && alignment.profile_points() > 0, "range_bias",
                "none without both sensors");
  echoes_.load(file);
  if (!file.has("range_bias/displacement_m")) return;
  expected_ = make_ridge();
  expected_->load(file.group("range_bias"), inputs(alignment), 1);
  by_angle_ = alignment.array_features() > 0;
  displacements_m_ = file.read<float>("range_bias/displacement_m", {record::H5File::any});
  for (const float metres : displacements_m_)
    require_sound(file, std::abs(metres) < longest_m, "range_bias/displacement_m",
                  "less than 100 m");
}

std::optional<RangeBias> RangeBiasWatch::add(const RangeBiasReference& reference,
                                             const std::vector<float>& found_m) {
  const std::size_t looks = watched_ / watch_every;
  displacements_m_.insert(displacements_m_.end(), found_m.begin(), found_m.end());
  watched_ += found_m.size();
  if (displacements_m_.size() > window)
    displacements_m_.erase(displacements_m_.begin(),
                           displacements_m_.end() - static_cast<std::ptrdiff_t>(window));
  if (watched_ / watch_every == looks) return {};
  const RangeBias range_bias = reference.judge(displacements_m_);
  const bool news =
      range_bias.status == RangeBias::Status::detected && status_ != range_bias.status;
  status_ = range_bias.status;
  return news ? std::optional(range_bias) : std::nullopt;
}

}  // namespace echofuse::recon

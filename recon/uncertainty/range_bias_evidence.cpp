// SPDX-License-Identifier: MIT
#include "recon/uncertainty/range_bias_evidence.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/core/random.hpp"
#include "recon/data/shift.hpp"
#include "recon/files/text.hpp"
#include "recon/models/body/alignment.hpp"
#include "recon/numbers/matrix_file.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr double edge = 0.05;         // quantile
constexpr double most_spread = 0.5;   // of a steady bin's median, between the edges
constexpr double least_power = 0.02;  // of the strongest bin's median: less is noise
constexpr double longest_m = 0.4, step_m = 0.01, usable_m = 0.05;
constexpr std::size_t least_empty = 5, least_records = 20;
constexpr double steps_a_resolution = 2;
constexpr int resamples = 30;
constexpr std::size_t mirrored = 8;                // bins
constexpr float strongest_power = 1e18f;           // of a model file
constexpr std::uint64_t echo_stream = 0x6563686f;  // "echo"
constexpr double apart = 3;  // standard errors at which two lengths are not the same

Rows with_radar(const Dataset& data, const Rows& rows) {
  Rows out;
  for (const std::size_t row : rows)
    if (data.fault_of(row, Inputs::radar).empty()) out.push_back(row);
  return out;
}

// By a record's total, so that gains do not matter; all bins alike.
double scale_between(std::span<const float> found, std::span<const float> expected,
                     const Rows& bins) {
  double product = 0, squares = 0;
  for (const std::size_t b : bins)
    product += double{found[b]} * double{expected[b]}, squares += std::pow(double{expected[b]}, 2);
  return squares > 0 ? product / squares : 0;
}

bool differ(double a, double b, double standard_error) {
  return std::abs(a - b) > apart * standard_error;
}

std::string centimetres(double metres, double standard_error_m) {
  return formatted("%+.1f +- %.1f cm", metres * 100, standard_error_m * 100);
}

RangeBiasEvidence by_echoes(const MovedBodies& bodies, const EchoMove& echoes) {
  using Says = RangeBiasEvidence::Says;
  if (!echoes.seen) return {};
  const std::string moved =
      "what stands still moved by " + centimetres(echoes.moved_m, echoes.standard_error_m) +
      (echoes.empty_records > 0 ? formatted(" in %zu empty records", echoes.empty_records) : "");
  const double both = std::hypot(echoes.standard_error_m, bodies.standard_error_m);
  const bool with_bodies = !differ(echoes.moved_m, bodies.moved_m, both);
  const bool stayed = !differ(echoes.moved_m, 0, echoes.standard_error_m);
  if (with_bodies && !stayed) return {Says::range_bias, moved + ", so it is a range bias"};
  if (stayed && !with_bodies)
    return {Says::no_range_bias,
            moved + ", so it is no range bias: people stand to one side or reflect otherwise"};
  return {Says::nothing, moved + ", which does not tell"};
}

RangeBiasEvidence by_brightness(const MovedBodies& bodies, const GainCheck& gains) {
  using Says = RangeBiasEvidence::Says;
  if (gains.records == 0 || !(gains.standard_error > 0) || gains.change <= -1) return {};
  const double found = std::log1p(gains.change);
  // The radar's own distance grows by moved_m, and the power falls with its fourth power.
  const double of_side = -4 * bodies.moved_m / bodies.range_m;
  const double error_of_side = 4 * bodies.standard_error_m / bodies.range_m;
  const bool like_side = !differ(found, of_side, std::hypot(gains.standard_error, error_of_side));
  const bool unchanged = !differ(found, 0, gains.standard_error);
  const std::string changed = formatted("the brightness changed by %+.1f +- %.1f %%",
                                        gains.change * 100, gains.standard_error * 100);
  if (unchanged && !like_side)
    return {Says::range_bias, changed + ", so people do not stand to one side"};
  if (like_side && !unchanged)
    return {Says::no_range_bias, changed + ", as of people who stand to one side"};
  if (like_side) return {Says::nothing, changed + ", which does not tell"};
  return {Says::nothing, changed +
                             ", which neither explains: a gain has changed as well, or bodies "
                             "reflect otherwise (gain or bias)"};
}

}  // namespace

StaticEchoes::StaticEchoes(const Dataset& data, const Rows& rows) {
  const Rows live = with_radar(data, rows);
  if (live.size() < least_records || data.radar_axis.quantity != "power") return;
  power_ = column_quantile(data.radar, live, 0.5);
  const auto low = column_quantile(data.radar, live, edge);
  const auto high = column_quantile(data.radar, live, 1 - edge);
  const float strongest = *std::max_element(power_.begin(), power_.end());
  steady_.assign(power_.size(), 0);
  for (std::size_t b = 0; b < power_.size(); ++b)
    if (double{power_[b]} > least_power * double{strongest} &&
        double{high[b]} - double{low[b]} < most_spread * double{power_[b]})
      steady_[b] = 1;
  if (!known()) power_.clear(), steady_.clear();
}

bool StaticEchoes::known() const { return std::count(steady_.begin(), steady_.end(), 1.f) >= 2; }

// By which the training's profile is moved to fit best. What is at range 0 has its other half
// before it, as the point spread is symmetric.
double StaticEchoes::move_of(const std::vector<float>& profile, const Rows& bins,
                             double axis_step_m) const {
  const std::size_t before = std::min(mirrored, power_.size() - 1);
  std::vector<float> both(power_.rend() - 1 - static_cast<std::ptrdiff_t>(before),
                          power_.rend() - 1);
  both.insert(both.end(), power_.begin(), power_.end());
  std::vector<double> misfit;
  const int most = static_cast<int>(std::lround(longest_m / step_m));
  for (int k = -most; k <= most; ++k) {
    auto expected = Shift(-k * step_m / axis_step_m).apply(both);
    expected.erase(expected.begin(), expected.begin() + static_cast<std::ptrdiff_t>(before));
    const double times = scale_between(profile, expected, bins);
    misfit.push_back(0);
    for (const std::size_t b : bins)
      misfit.back() += std::pow(double{profile[b]} - times * double{expected[b]}, 2);
  }
  const auto at = std::clamp<std::ptrdiff_t>(
      std::min_element(misfit.begin(), misfit.end()) - misfit.begin(), 1, std::ssize(misfit) - 2);
  const auto k = static_cast<std::size_t>(at);
  const double bend = misfit[k - 1] - 2 * misfit[k] + misfit[k + 1];
  const double part = bend > 0 ? (misfit[k - 1] - misfit[k + 1]) / (2 * bend) : 0;
  return (static_cast<double>(at - most) + std::clamp(part, -0.5, 0.5)) * step_m;
}

EchoMove StaticEchoes::judge(const Dataset& data, const Matrix& aligned, bool longer) const {
  EchoMove out;
  if (!known() || data.radar_axis.count != power_.size()) return out;
  Rows bins, rows = with_radar(data, all_rows(data.size())), empty;
  const double resolution_m = steps_a_resolution * data.radar_axis.step;
  for (std::size_t b = 0; b < steady_.size(); ++b)
    if (steady_[b] != 0 && (longer || data.radar_axis.at(static_cast<double>(b)) >= resolution_m))
      bins.push_back(b);
  for (const std::size_t row : rows)
    if (data.fault_of(row, Inputs::fused_profile).empty() && !shows_body(aligned.row(row)))
      empty.push_back(row);
  if (empty.size() >= least_empty) out.empty_records = empty.size(), rows = empty;
  if (bins.size() < 2 || (out.empty_records == 0 && rows.size() < least_records)) return out;
  const auto of = [&](const Rows& some) {
    return move_of(column_quantile(data.radar, some, 0.5), bins, data.radar_axis.step);
  };
  out.moved_m = of(rows), out.records = rows.size();
  std::vector<double> moves;
  Rng rng = make_rng(rows.size(), echo_stream);
  for (int i = 0; i < resamples; ++i) {
    Rows some;
    const std::size_t block = out.empty_records > 0 ? 1 : pose_records;
    for (const std::size_t k : resampled_blocks(rows.size(), rows.size(), rng, block))
      some.push_back(rows[k]);
    moves.push_back(of(some));
  }
  // What the search's own step and the training's noise leave.
  out.standard_error_m = std::max(standard_deviation(moves), step_m / 5);
  out.seen = apart * out.standard_error_m < usable_m;
  return out;
}

void StaticEchoes::save(record::H5File& file) const {
  if (!known()) return;
  file.write("range_bias/static_power", power_, {power_.size()});
  file.write("range_bias/static_bins", steady_, {steady_.size()});
}

void StaticEchoes::load(const record::H5File& file) {
  power_.clear(), steady_.clear();
  if (!file.has("range_bias/static_power")) return;
  power_ = file.read<float>("range_bias/static_power", {record::H5File::any});
  steady_ = file.read<float>("range_bias/static_bins", {power_.size()});
  for (const float v : power_)
    require_sound(file, std::abs(v) < strongest_power, "range_bias/static_power", "powers");
}

RangeBiasEvidence weigh(const MovedBodies& bodies, const EchoMove& echoes, const GainCheck& gains) {
  using Says = RangeBiasEvidence::Says;
  const RangeBiasEvidence a = by_echoes(bodies, echoes), b = by_brightness(bodies, gains);
  RangeBiasEvidence out{a.says != Says::nothing ? a.says : b.says, a.text};
  if (!a.text.empty() && !b.text.empty()) out.text += "; ";
  out.text += b.text;
  // Two that contradict each other decide nothing.
  if (a.says != Says::nothing && b.says != Says::nothing && a.says != b.says)
    out = {Says::nothing, out.text + ": these contradict each other"};
  return out;
}

std::string calibration_age(const Dataset& data) {
  if (data.sources.empty() || !data.sources.front().calibrated_days) return {};
  return formatted("calibrated %.0f days before the run", *data.sources.front().calibrated_days);
}

}  // namespace echofuse::recon

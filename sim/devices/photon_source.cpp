// SPDX-License-Identifier: MIT
#include "sim/devices/photon_source.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "drivers/core/axis.hpp"
#include "drivers/util/exit_code.hpp"
#include "sim/wire/encode.hpp"

namespace echofuse::sim {
namespace {

constexpr double max_tags_per_s = 5e6;
// A detection is stored as pulse << 32 | delay in ps, so the laser period must be less than 2^32
// ps.
constexpr double longest_period_ps = 4e9;

std::string in_mhz(double hz) { return std::to_string(hz / 1e6) + " MHz"; }

void check(const Conditions& c, const Tagging& t, double window_s) {
  const double last_ps = c.first_bin_ps + static_cast<double>(c.bins) * c.bin_width_ps;
  if (t.laser_rate_hz * last_ps > 1e12)
    throw Error(ExitCode::config,
                "laser rate " + in_mhz(t.laser_rate_hz) +
                    ": the next pulse is emitted before the end of the last bin at " +
                    std::to_string(last_ps / 1e3) + " ns; expected at most " +
                    in_mhz(1e12 / last_ps));
  if (t.laser_rate_hz * longest_period_ps < 1e12)
    throw Error(ExitCode::config,
                "laser rate " + std::to_string(t.laser_rate_hz) + " Hz: expected at least 250 Hz");
  const double photons = (c.signal_photons + c.background_counts) / window_s;
  const double tags = t.conditional_filter ? 2 * photons : photons + t.laser_rate_hz;
  if (tags > max_tags_per_s)
    throw Error(
        ExitCode::config,
        std::to_string(tags / 1e6) +
            " million tags per second (photon counts divided by the window of " +
            std::to_string(window_s) +
            " s): the simulated tagger supports at most 5 million; reduce the photon counts");
}

}  // namespace

PhotonSource::PhotonSource(const Conditions& conditions, const Tagging& tagging, double window_s,
                           std::uint64_t seed)
    : conditions_(conditions),
      tagging_(tagging),
      window_s_(window_s),
      rng_(make_rng(seed, 1)),
      jitter_(0, conditions.irf_fwhm_ps / (2 * std::sqrt(2 * std::numbers::ln2))) {
  if (conditions.pulses_per_window > 0)
    tagging_.laser_rate_hz = static_cast<double>(conditions.pulses_per_window) / window_s;
  check(conditions_, tagging_, window_s_);
  period_ps_ = 1e12 / tagging_.laser_rate_hz;
}

void PhotonSource::set_returns(const Returns& returns) {
  delay_ps_.clear();
  cumulative_.clear();
  double sum = 0;
  for (std::size_t k = 0; k < returns.range_m.size(); ++k) {
    sum += returns.weight[k];
    cumulative_.push_back(sum);
    delay_ps_.push_back(ps_per_m * returns.range_m[k]);
  }
}

double PhotonSource::windows(std::int64_t pulses) const {
  return gain_ * static_cast<double>(pulses) / tagging_.laser_rate_hz / window_s_;
}
double PhotonSource::mean_signal(std::int64_t pulses) const {
  return cumulative_.empty() ? 0
                             : windows(pulses) * conditions_.signal_photons * cumulative_.back();
}
double PhotonSource::mean_background(std::int64_t pulses) const {
  return windows(pulses) * conditions_.background_counts;
}

double PhotonSource::mean_tags(std::int64_t pulses) const {
  const double all = static_cast<double>(pulses);
  const double photons = mean_signal(pulses) + mean_background(pulses);
  const double pulses_with_photon = -all * std::expm1(-photons / all);
  return (tagging_.conditional_filter ? pulses_with_photon : all) +
         (only_first() ? pulses_with_photon : photons);
}

bool PhotonSource::only_first() const {
  return conditions_.pulses_per_window > 0 && conditions_.spd_dead_time_ps <= 0;
}

double PhotonSource::signal_delay_ps() {
  std::uniform_real_distribution<double> share(0, cumulative_.back());
  const auto it = std::upper_bound(cumulative_.begin(), cumulative_.end(), share(rng_));
  const auto k = std::min<std::ptrdiff_t>(it - cumulative_.begin(),
                                          static_cast<std::ptrdiff_t>(cumulative_.size()) - 1);
  double delay = delay_ps_[static_cast<std::size_t>(k)] + jitter_(rng_);
  if (conditions_.irf_tail_ps > 0 &&
      std::uniform_real_distribution<double>()(rng_) < conditions_.irf_tail_share)
    delay += std::exponential_distribution<double>(1 / conditions_.irf_tail_ps)(rng_);
  return delay;
}

double PhotonSource::background_delay_ps() {
  const double span = static_cast<double>(conditions_.bins) * conditions_.bin_width_ps;
  return conditions_.first_bin_ps + std::uniform_real_distribution<double>(0, span)(rng_);
}

void PhotonSource::draw_detections(std::int64_t pulses, double mean, bool signal) {
  if (!(mean > 0)) return;
  const auto count = std::poisson_distribution<std::int64_t>(mean)(rng_);
  std::uniform_int_distribution<std::int64_t> pulse(0, pulses - 1);
  for (std::int64_t i = 0; i < count; ++i) {
    const double delay = signal ? signal_delay_ps() : background_delay_ps();
    // Detections outside the laser period would violate the chronological order of the stream. They
    // lie outside every histogram, so they are dropped.
    if (!(delay >= 0 && delay < period_ps_ - 1)) continue;
    // Rounds the delay down, so that a detection stays in its bin if the bin edges are whole
    // picoseconds.
    detections_.push_back(static_cast<std::uint64_t>(pulse(rng_)) << 32 |
                          static_cast<std::uint64_t>(delay));
  }
}

void PhotonSource::wait_for_detector(std::int64_t first) {
  const auto blind = [&](std::uint64_t detection) {
    const double time_ps =
        static_cast<double>(first + static_cast<std::int64_t>(detection >> 32)) * period_ps_ +
        static_cast<double>(detection & 0xffffffffU);
    if (time_ps < ready_ps_) return true;
    ready_ps_ = time_ps + conditions_.spd_dead_time_ps;
    return false;
  };
  std::vector<std::uint64_t> kept;
  std::copy_if(detections_.begin(), detections_.end(), std::back_inserter(kept),
               [&](std::uint64_t d) { return !blind(d); });
  detections_ = std::move(kept);
}

std::size_t PhotonSource::put_pulse(std::int64_t pulse, std::size_t& next, std::int64_t first,
                                    Bytes& out) {
  const std::size_t before = out.size();
  const auto fired_ps =
      static_cast<std::int64_t>(std::llround(static_cast<double>(pulse) * period_ps_));
  put_tag(out, tagging_.sync_channel, fired_ps);
  bool kept = false;
  for (; next < detections_.size() &&
         static_cast<std::int64_t>(detections_[next] >> 32) == pulse - first;
       ++next) {
    if (kept && only_first()) continue;
    put_tag(out, tagging_.click_channel,
            fired_ps + static_cast<std::int64_t>(detections_[next] & 0xffffffffU));
    kept = true;
  }
  return (out.size() - before) / tag_bytes;
}

std::size_t PhotonSource::draw(std::int64_t first, std::int64_t last, Bytes& out) {
  detections_.clear();
  draw_detections(last - first, mean_signal(last - first), true);
  draw_detections(last - first, mean_background(last - first), false);
  std::sort(detections_.begin(), detections_.end());
  if (conditions_.spd_dead_time_ps > 0) wait_for_detector(first);
  std::size_t next = 0, tags = 0;
  if (!tagging_.conditional_filter)
    for (std::int64_t pulse = first; pulse < last; ++pulse)
      tags += put_pulse(pulse, next, first, out);
  while (next < detections_.size())
    tags += put_pulse(first + static_cast<std::int64_t>(detections_[next] >> 32), next, first, out);
  return tags;
}

}  // namespace echofuse::sim

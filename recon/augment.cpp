// SPDX-License-Identifier: MIT
#include "recon/augment.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <random>

#include "drivers/core/random.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t augment_stream = 0x6175676d;  // "augm"
constexpr double least_snr_db = 10, most_snr_db = 20;

void add_noise(std::span<float> power, double mean_peak, Rng& rng) {
  const double snr_db = std::uniform_real_distribution<double>(least_snr_db, most_snr_db)(rng);
  std::normal_distribution<double> noise(0, mean_peak * std::pow(10, -snr_db / 10));
  for (float& v : power) v += static_cast<float>(noise(rng));
}

// |sum_k sqrt(p_k) exp(i phi_k) psf(R - R_k)|^2 over scatterers of random phase, one a point of the
// profile, whose amplitude response is as wide as the points' sampling allows: a sinc of two steps.
void add_speckle(std::span<float> power, Rng& rng) {
  constexpr double cell = 2;  // steps to a range resolution, c / 2B
  constexpr int reach = 8;
  std::normal_distribution<double> amplitude(0, std::sqrt(0.5));
  const auto count = static_cast<int>(power.size());
  std::vector<std::complex<double>> profile(power.size());
  double before = 0, after = 0;
  for (int k = 0; k < count; ++k) {
    const double p = std::max(double{power[static_cast<std::size_t>(k)]}, 0.0);
    const std::complex<double> a =
        std::sqrt(p) * std::complex<double>(amplitude(rng), amplitude(rng));
    before += p;
    for (int i = std::max(k - reach, 0); i < std::min(k + reach + 1, count); ++i) {
      const double x = std::numbers::pi * (i - k) / cell;
      profile[static_cast<std::size_t>(i)] += a * (x == 0 ? 1 : std::sin(x) / x);
    }
  }
  for (const auto& y : profile) after += std::norm(y);
  const double scale = after > 0 ? before / after : 0;
  for (std::size_t i = 0; i < power.size(); ++i)
    power[i] = static_cast<float>(std::norm(profile[i]) * scale);
}

double mean_peak_of(const Matrix& profiles, const Rows& rows) {
  double sum = 0;
  for (const std::size_t row : rows)
    sum += double{*std::max_element(profiles.row(row).begin(), profiles.row(row).end())};
  return sum / static_cast<double>(rows.size());
}

std::size_t append_copy(Dataset& data, std::size_t row) {
  for (Matrix* table : {&data.spd, &data.radar, &data.depth}) {
    const std::vector<float> copy(table->row(row).begin(), table->row(row).end());
    table->add_row(copy);
  }
  data.valid.push_back(data.valid[row]);
  data.index.push_back(data.index[row]);
  data.slot_end.push_back(data.slot_end[row]);
  data.label.push_back(data.label[row]);
  return data.size() - 1;
}

}  // namespace

void augment(Dataset& data, Rows& rows, const std::vector<std::string>& kinds, std::uint64_t seed) {
  const Rows originals = rows;
  const double mean_peak = data.radar.cols > 0 ? mean_peak_of(data.radar, originals) : 0;
  Rng rng = make_rng(seed, augment_stream);
  for (const auto& kind : kinds) {
    if (std::find(augment_names.begin(), augment_names.end(), kind) == augment_names.end())
      throw Error(ExitCode::usage, "augment \"" + kind + "\": expected noise or speckle");
    for (const std::size_t original : originals) {
      rows.push_back(append_copy(data, original));
      const auto radar = data.radar.row(rows.back());
      if (kind == "noise") add_noise(radar, mean_peak, rng);
      if (kind == "speckle") add_speckle(radar, rng);
    }
  }
}

}  // namespace echofuse::recon

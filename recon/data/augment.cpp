// SPDX-License-Identifier: MIT
#include "recon/data/augment.hpp"

#include <algorithm>
#include <cmath>
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

double mean_peak_of(const Matrix& profiles, const Rows& rows) {
  double sum = 0;
  for (const std::size_t row : rows)
    sum += double{*std::max_element(profiles.row(row).begin(), profiles.row(row).end())};
  return sum / static_cast<double>(rows.size());
}

}  // namespace

void augment(Dataset& data, Rows& rows, const std::vector<std::string>& kinds, std::uint64_t seed) {
  const Rows originals = rows;
  const double mean_peak = data.radar.cols > 0 ? mean_peak_of(data.radar, originals) : 0;
  Rng rng = make_rng(seed, augment_stream);
  Rows all = all_rows(data.size());
  for (const auto& kind : kinds) {
    if (std::find(augment_names.begin(), augment_names.end(), kind) == augment_names.end())
      throw Error(ExitCode::usage, "augment \"" + kind + "\": expected noise");
    for (const std::size_t original : originals) {
      rows.push_back(all.size());
      all.push_back(original);
    }
  }
  const std::size_t recorded = data.size();
  const std::uint32_t hash = data.hash;
  data = part_of(data, all);
  data.hash = hash;
  for (std::size_t row = recorded; row < data.size(); ++row)
    add_noise(data.radar.row(row), mean_peak, rng);
}

}  // namespace echofuse::recon

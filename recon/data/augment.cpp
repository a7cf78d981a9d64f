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

std::size_t append_copy(Dataset& data, std::size_t row) {
  for (Matrix* table : {&data.spd, &data.radar, &data.depth}) {
    const std::vector<float> copy(table->row(row).begin(), table->row(row).end());
    table->add_row(copy);
  }
  data.valid.push_back(data.valid[row]);
  data.index.push_back(data.index[row]);
  data.slot_end.push_back(data.slot_end[row]);
  data.clicks_a_pulse.push_back(data.clicks_a_pulse[row]);
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
      throw Error(ExitCode::usage, "augment \"" + kind + "\": expected noise");
    for (const std::size_t original : originals) {
      rows.push_back(append_copy(data, original));
      add_noise(data.radar.row(rows.back()), mean_peak, rng);
    }
  }
}

}  // namespace echofuse::recon

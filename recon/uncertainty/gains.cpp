// SPDX-License-Identifier: MIT
#include "recon/uncertainty/gains.hpp"

#include <cmath>
#include <vector>

#include "recon/files/text.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t least_records = 50, block = 10;  // half a minute of records: a pose held
// A change of 2 % costs nothing, one of 5 % as much as brightness brings.
constexpr double most_change = 0.03, most_standard_error = 0.015;

}  // namespace

std::string GainCheck::text() const {
  if (stable || records == 0) return {};
  const std::string end = ": brightness is not used";
  if (records < least_records)
    return formatted("%zu records with a body are too few to check the gains", records) + end;
  if (std::abs(change) <= most_change)
    return formatted("gains are known to %.1f %% only, of %zu records", standard_error * 100,
                     records) +
           end;
  return formatted(
             "the radar's power against the SPD's clicks is %.1f +- %.1f %% %s than in training: a "
             "gain has changed, or people stand to one side",
             std::abs(change) * 100, standard_error * 100, change > 0 ? "more" : "less") +
         end;
}

GainCheck check_gains(const Alignment& alignment, const Matrix& aligned) {
  GainCheck out;
  double sum = 0;
  std::vector<double> blocks;  // means
  for (std::size_t i = 0; i < aligned.rows; ++i) {
    const auto brightness = alignment.brightness_of(aligned.row(i));
    if (!Brightness::known(brightness)) continue;
    out.change += double{brightness[0]}, sum += double{brightness[0]};
    if (++out.records % block == 0) blocks.push_back(sum / block), sum = 0;
  }
  if (out.records < least_records) return out;
  out.change = std::expm1(out.change / static_cast<double>(out.records));
  out.standard_error = standard_deviation(blocks) / std::sqrt(static_cast<double>(blocks.size()));
  out.stable = std::abs(out.change) <= most_change && out.standard_error <= most_standard_error;
  return out;
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include "recon/data/depth_check.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::recon {
namespace {

constexpr double nearest_m = 0.05;  // below the minimum range of any depth camera

std::string length_text(double m) {
  return m < 0.1 ? format("%.3g mm", 1000 * m) : format("%.3g m", m);
}

}  // namespace

void DepthCheck::add(std::span<const std::uint16_t> mm, double far_m) {
  std::size_t p = 0;
  // Neighbouring pixels use different counters, because they often have the same depth, and
  // incrementing the same counter twice in a row is slow.
  for (; p + 4 <= mm.size(); p += 4)
    if ((mm[p] | mm[p + 1] | mm[p + 2] | mm[p + 3]) != 0)
      for (std::size_t k = 0; k < 4; ++k) ++counts_[k][mm[p + k]];
  for (; p < mm.size(); ++p) ++counts_[0][mm[p]];
  const std::uint16_t farthest = mm.empty() ? 0 : *std::ranges::max_element(mm);
  ++records_, records_beyond_ += farthest > std::lround(1000 * far_m);
  far_m_ = far_m;
}

std::uint64_t DepthCheck::farther_than(std::int64_t mm) const {
  std::uint64_t out = 0;
  for (const auto& count : counts_) out = std::accumulate(count.begin() + mm + 1, count.end(), out);
  return out;
}

double DepthCheck::median_m() const {
  std::size_t mm = 0;
  const std::uint64_t returns = farther_than(0);
  for (std::uint64_t below = 0; 2 * below < returns;) {
    ++mm;
    for (const auto& count : counts_) below += count[mm];
  }
  return static_cast<double>(mm) / 1000;
}

std::string DepthCheck::text(const std::string& path, const Axis& spd) const {
  const std::uint64_t returns = farther_than(0);
  if (returns == 0) return {};
  const double median = median_m();
  const std::string run = printable(path) + ": ";
  if (median < nearest_m)
    throw Error(ExitCode::failed, run + "the median depth is " + length_text(median) +
                                      "; expected metres in arrays, millimetres in images");
  std::string out;
  if (records_beyond_ > 0)
    out = format(
        "%zu of %zu records have depths beyond %.4g m, treated as no return (%.3g %% of "
        "all depths; median depth %s); map_z_max_m sets this limit",
        records_beyond_, records_, far_m_,
        100 * static_cast<double>(farther_than(std::lround(1000 * far_m_))) /
            static_cast<double>(returns),
        length_text(median).c_str());
  const double from_m = spd.start / ps_per_m, to_m = spd.at(spd.count) / ps_per_m;
  if (spd.unit == "ps" && (2 * median < from_m || median > to_m))
    out += format(
        "%sthe median depth is %s, but the histogram covers %.3g to %.3g m; expected depths in "
        "metres",
        out.empty() ? "" : "; ", length_text(median).c_str(), from_m, to_m);
  return out.empty() ? out : run + out;
}

}  // namespace echofuse::recon

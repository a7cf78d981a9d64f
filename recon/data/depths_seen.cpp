// SPDX-License-Identifier: MIT
#include "recon/data/depths_seen.hpp"

#include <cmath>

#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"
#include "recon/numbers/text.hpp"

namespace echofuse::recon {
namespace {

constexpr double nearest_m = 0.05;  // no depth camera sees nearer

std::string length_text(double m) {
  return m < 0.1 ? formatted("%.3g mm", 1000 * m) : formatted("%.3g m", m);
}

}  // namespace

void DepthsSeen::add(std::span<const std::uint16_t> mm, double far_m) {
  const auto most = std::lround(1000 * far_m);
  std::uint64_t returns = 0, beyond = 0;
  for (const std::uint16_t depth : mm)
    ++count_[depth], returns += depth > 0, beyond += depth > most;
  returns_ += returns, beyond_ += beyond;
  ++records_, records_beyond_ += beyond > 0;
  far_m_ = far_m;
}

double DepthsSeen::median_m() const {
  std::size_t mm = 0;
  for (std::uint64_t below = 0; 2 * below < returns_;) below += count_[++mm];
  return static_cast<double>(mm) / 1000;
}

std::string DepthsSeen::text(const std::string& path, const Axis& spd) const {
  if (returns_ == 0) return {};
  const double median = median_m();
  const std::string run = printable(path) + ": ";
  if (median < nearest_m)
    throw Error(ExitCode::failed, run + "the median depth is " + length_text(median) +
                                      ": metres are expected, as millimetres in the images");
  std::string out;
  if (beyond_ > 0)
    out = formatted(
        "%zu of %zu records have depths beyond %.4g m, taken as no return (%.3g %% of "
        "all depths, whose median is %s); map_z_max_m is the map's range",
        records_beyond_, records_, far_m_,
        100 * static_cast<double>(beyond_) / static_cast<double>(returns_),
        length_text(median).c_str());
  const double from_m = spd.start / ps_per_m, to_m = spd.at(spd.count) / ps_per_m;
  if (spd.unit == "ps" && (2 * median < from_m || median > to_m))
    out += formatted(
        "%sthe median depth is %s, where the histogram spans %.3g to %.3g m: metres "
        "are expected",
        out.empty() ? "" : "; ", length_text(median).c_str(), from_m, to_m);
  return out.empty() ? out : run + out;
}

}  // namespace echofuse::recon

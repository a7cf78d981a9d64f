// SPDX-License-Identifier: MIT
#include "acquire/intake/clock_rate.hpp"

#include <cmath>
#include <utility>

#include "acquire/intake/clock_fit.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::acquire {
namespace {

using namespace std::chrono_literals;

constexpr auto interval = 2s;
constexpr double tolerated = 0.1, like_before = 0.05;

}  // namespace

std::string ClockRate::add(std::uint64_t ticks, HostTime received) {
  if (from_ && received - from_->received < interval) return {};
  const auto from = std::exchange(from_, Reading{ticks, received});
  if (!from) return {};
  const double passed = seconds(received - from->received) / tick_s_;
  const double rate =
      static_cast<double>(ticks_passed(from->ticks, ticks, passed, spare_bits_)) / passed;
  const auto before = std::exchange(before_, rate);
  if (near(rate, 1, tolerated) || rate < 0 || !before || !near(rate, *before, like_before))
    return {};
  if (rate == 0) return "stands still";
  const double slower = std::round(1 / rate);
  const std::string at = rate < 1 && near(1 / rate, slower, 0.03) ? format("1/%.0f of", slower)
                                                                  : format("%.4g times", rate);
  return "runs at " + at + " the rate of the host clock";
}

}  // namespace echofuse::acquire

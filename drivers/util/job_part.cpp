// SPDX-License-Identifier: MIT
#include "drivers/util/job_part.hpp"

#include <charconv>
#include <optional>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse {
namespace {

constexpr std::int64_t max_parts = 100'000;

std::optional<std::int64_t> number_of(std::string_view text) {
  std::int64_t out = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return out;
}

}  // namespace

JobPart JobPart::of(const std::string& text) {
  std::optional<std::int64_t> number, count;
  if (const auto slash = text.find('/'); slash != text.npos) {
    number = number_of(std::string_view(text).substr(0, slash));
    count = number_of(std::string_view(text).substr(slash + 1));
  }
  if (!number || !count || *number < 1 || *number > *count || *count > max_parts)
    throw Error(ExitCode::usage, "--part " + printable(text, 40) +
                                     ": expected K/N with 1 <= K <= N <= 100000, for example " +
                                     "$SLURM_ARRAY_TASK_ID/16 in a Slurm job array");
  return {*number, *count};
}

std::string JobPart::name() const {
  return "part-" + std::to_string(number_) + "-of-" + std::to_string(count_);
}

JobPart::IndexRange JobPart::range(std::int64_t pieces) const {
  return {pieces * (number_ - 1) / count_, pieces * number_ / count_};
}

}  // namespace echofuse

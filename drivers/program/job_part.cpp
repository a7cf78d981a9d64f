// SPDX-License-Identifier: MIT
#include "drivers/program/job_part.hpp"

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <numeric>
#include <optional>

#include "drivers/program/printable.hpp"

namespace echofuse {
namespace {

constexpr std::int64_t most_parts = 100'000;

std::optional<std::int64_t> number_of(std::string_view text) {
  std::int64_t out = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return out;
}

// True for "part-K-of-N" with an extension of so many letters.
bool is_part(std::string_view name, std::size_t extension) {
  constexpr std::string_view part = "part-", of = "-of-";
  const auto digits = [](std::string_view text) {
    return !text.empty() && text.find_first_not_of("0123456789") == text.npos;
  };
  if (!name.starts_with(part) || name.size() < part.size() + extension) return false;
  name = name.substr(part.size(), name.size() - part.size() - extension);
  const auto between = name.find(of);
  return between != name.npos && digits(name.substr(0, between)) &&
         digits(name.substr(between + of.size()));
}

}  // namespace

JobPart JobPart::of(const std::string& text) {
  std::optional<std::int64_t> number, count;
  if (const auto slash = text.find('/'); slash != text.npos) {
    number = number_of(std::string_view(text).substr(0, slash));
    count = number_of(std::string_view(text).substr(slash + 1));
  }
  if (!number || !count || *number < 1 || *number > *count || *count > most_parts)
    throw Error(ExitCode::usage, "--part " + printable(text, 40) +
                                     ": expected K/N with 1 <= K <= N <= 100000, as " +
                                     "$SLURM_ARRAY_TASK_ID/16 in a job array of Slurm");
  return {*number, *count};
}

std::string JobPart::name() const {
  return "part-" + std::to_string(number_) + "-of-" + std::to_string(count_);
}

JobPart::Range JobPart::range(std::int64_t pieces) const {
  return {pieces * (number_ - 1) / count_, pieces * number_ / count_};
}

std::vector<bool> JobPart::share(const std::vector<double>& work) const {
  const double all = std::accumulate(work.begin(), work.end(), 0.);
  std::vector<bool> out;
  double before = 0;
  for (const double piece : work) {
    const double middle = all > 0 ? (before + piece / 2) / all : 0;
    const auto owner = static_cast<std::int64_t>(middle * static_cast<double>(count_));
    out.push_back(std::min(owner, count_ - 1) == number_ - 1);
    before += piece;
  }
  return out;
}

void refuse_part(ExitCode code, const std::string& path, const std::string& line,
                 const std::string& expected) {
  throw Error(code, printable(path) + ": was measured with \"" + printable(line, 100) +
                        "\" (now: \"" + printable(expected, 100) +
                        "\"); give the same settings, or another folder");
}

std::vector<std::string> part_files(const std::string& folder, const std::string& stem,
                                    const std::string& extension) {
  std::vector<std::string> out;
  std::error_code none;
  for (const auto& entry : std::filesystem::directory_iterator(folder, none)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with(stem) && name.ends_with(extension) &&
        is_part(std::string_view(name).substr(stem.size()), extension.size()))
      out.push_back(entry.path().string());
  }
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace echofuse

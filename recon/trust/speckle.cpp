// SPDX-License-Identifier: MIT
#include "recon/trust/speckle.hpp"

#include <algorithm>
#include <vector>

#include "recon/files/text.hpp"
#include "recon/method/alignment.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr double false_alarms = 0.001;
// The median of many records scatters less than one.
constexpr std::size_t many = 20;
constexpr double most_of_run = 0.5;
// Variation that plain noise may make, and which differs with it: below, little is told apart.
constexpr double least = 0.3;
constexpr double least_off = 0.25;  // of logarithms: so much differs from laboratory to laboratory
// Of the variation from frame to frame what comes within 150 ms: of noise all, and of who moves
// fast. Then it tells nothing of slow motion.
constexpr double most_within_150_ms = 0.75;

enum Kind : std::size_t { of_frames, of_carriers, of_150_ms };
struct KindOf {
  std::optional<double> (*value)(const record::Speckle&);
  double least;  // added before the logarithm
  const char* name;
};
constexpr std::array kinds_of{
    KindOf{[](const record::Speckle& s) { return std::optional(s.over_frames); }, least,
           "from frame to frame"},
    KindOf{[](const record::Speckle& s) { return s.over_carriers; }, least,
           "from carrier to carrier"},
    KindOf{[](const record::Speckle& s) { return s.over_150_ms; }, 0.02, "within 150 ms"}};

std::optional<double> log_of(const record::Speckle& found, std::size_t kind) {
  const auto value = kinds_of[kind].value(found);
  return value ? std::optional(std::log(*value + kinds_of[kind].least)) : std::nullopt;
}

double variation_of(double log, std::size_t kind) {
  return std::max(std::exp(log) - kinds_of[kind].least, 0.0);
}

bool has_body(const Matrix& aligned, std::size_t row) {
  return aligned.cols == 0 || shows_body(aligned.row(row));
}

}  // namespace

SpeckleReference::SpeckleReference(const Dataset& data, const Matrix& aligned, const Rows& rows) {
  std::array<std::vector<float>, kinds> seen;
  for (const std::size_t row : rows)
    for (std::size_t k = 0; k < kinds && data.speckle[row] && has_body(aligned, row); ++k)
      if (const auto value = log_of(*data.speckle[row], k))
        seen[k].push_back(static_cast<float>(*value));
  if (seen[0].size() < least_records) return;
  records_ = seen[0].size();
  for (std::size_t k = 0; k < kinds; ++k) {
    if (seen[k].size() < least_records) continue;
    const float median = quantile(seen[k], 0.5);
    for (float& v : seen[k]) v = k == of_150_ms ? median - v : std::abs(v - median);
    usual_[k] = {double{median},
                 std::max(upper_limit(std::move(seen[k]), false_alarms), least_off)};
  }
  if (variation_of(usual_[of_150_ms].median, of_150_ms) >
      most_within_150_ms * variation_of(usual_[of_frames].median, of_frames))
    usual_[of_150_ms] = {};
}

double SpeckleReference::share(const record::Speckle& found, std::size_t kind) const {
  constexpr double missing = 2;
  const auto value = log_of(found, kind);
  const Usual& usual = usual_[kind];
  if (usual.most_off == 0) return 0;
  if (!value) return kind == of_carriers ? missing : 0;  // older runs say nothing of 150 ms
  const double more = *value - usual.median;
  return (kind == of_150_ms ? std::max(-more, 0.0) : std::abs(more)) / usual.most_off;
}

bool SpeckleReference::less_motion(const record::Speckle& found) const {
  return share(found, of_150_ms) > 1;
}

bool SpeckleReference::hops() const { return usual_[of_carriers].most_off > 0; }

std::size_t SpeckleReference::clearest(const record::Speckle& found) const {
  std::size_t out = 0;
  for (std::size_t k = 1; k < kinds; ++k)
    if (share(found, k) > share(found, out)) out = k;
  return out;
}

double SpeckleReference::share(const record::Speckle& found) const {
  return share(found, clearest(found));
}

std::string SpeckleReference::text(const record::Speckle& found, std::size_t kind) const {
  const auto value = kinds_of[kind].value(found);
  if (!value) return "one carrier, several in training";
  return formatted("%.2g %s, %.2g in training", *value, kinds_of[kind].name,
                   variation_of(usual_[kind].median, kind));
}

std::string SpeckleReference::text(const record::Speckle& found) const {
  return text(found, clearest(found));
}

std::string SpeckleReference::of_run(const Dataset& data, const Matrix& aligned) const {
  std::vector<float> frames, carriers, lagged;
  for (std::size_t row = 0; row < data.size(); ++row) {
    if (!data.speckle[row] || !has_body(aligned, row)) continue;
    frames.push_back(static_cast<float>(data.speckle[row]->over_frames));
    if (const auto v = data.speckle[row]->over_carriers) carriers.push_back(static_cast<float>(*v));
    if (const auto v = data.speckle[row]->over_150_ms) lagged.push_back(static_cast<float>(*v));
  }
  if (!known() || frames.empty()) return {};
  record::Speckle middle{double{quantile(frames, 0.5)}, {}, {}};
  // Of a run that was resumed by a newer version some records have them.
  const auto most_have = [&](const std::vector<float>& v) { return 2 * v.size() > frames.size(); };
  if (most_have(carriers)) middle.over_carriers = double{quantile(carriers, 0.5)};
  if (most_have(lagged)) middle.over_150_ms = double{quantile(lagged, 0.5)};
  if (share(middle) <= (frames.size() < many ? 1 : most_of_run)) return {};
  constexpr const char* places = "; places are known otherwise than stated";
  const std::string by = "the radar's power varies otherwise than in training: " + text(middle);
  if (hops() && !middle.over_carriers) return by + " (fewer independent looks)" + places;
  if (clearest(middle) == of_150_ms)
    return by + " (people who move less, or echoes that do not interfere)" + places;
  return by +
         (middle.over_frames + least > std::exp(usual_[of_frames].median)
              ? " (echoes that interfere, fewer carriers, or noise)"
              : " (people who move less, more carriers, or echoes that do not interfere)") +
         places;
}

void SpeckleReference::archive(Archive archive) {
  archive.count("records", records_, 0, 1 << 30);
  std::vector<double> values;
  for (const Usual& u : usual_) values.push_back(u.median), values.push_back(u.most_off);
  archive.values("usual", values, 2 * kinds);
  for (std::size_t k = 0; k < kinds; ++k) {
    usual_[k] = {values[2 * k], values[2 * k + 1]};
    archive.require(std::abs(usual_[k].median) < 1e9 && usual_[k].most_off >= 0, "usual",
                    "expected medians below 1e9 and limits of at least 0");
  }
}

}  // namespace echofuse::recon

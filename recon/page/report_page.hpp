// SPDX-License-Identifier: MIT
// Parts of the page of a report: what they say, and blocks of it (page.hpp).
#pragma once
#include <string>
#include <vector>

#include "recon/page/page.hpp"
#include "recon/page/report.hpp"

namespace echofuse::recon {

std::string short_name(const ModeResult& mode);
std::string title_of(const ModeResult& mode);  // "ours (factorised, SPD + 8 antennas)"
// SSIM that Lai et al., Chin. Opt. Lett. 22, 022701 (2024), state of their network on these inputs;
// 0 of any other model.
double paper_ssim(const ModeResult& mode);
const char* colour_of(const Report& report, std::size_t mode);  // of its series

// This is how the page names a metric, in what unit it gives it, and what is better.
enum class Best { more, less, zero };
struct MetricWords {
  Metric metric;
  const char *name, *unit;  // "lateral error", " cm"
  double scale;             // from the metric's own unit
  int decimals;
  Best best;
  std::string title() const;  // "lateral error (cm)"
  std::string text(double value, int more_decimals = 0) const;
};
const MetricWords& words_of(Metric metric);

// This is what the page says first: how good, against what, and in what it is worse.
std::string verdict(const Report& report);
// This is what fails, in sentences, the gravest first: of the scored run, of the
// live run.
struct Problem {
  std::string text;
  bool live = false;
};
std::vector<Problem> problems_of(const Report& report);
// This is what there is to say that is no failure: a run like the training, corrections.
std::vector<std::string> remarks_of(const Evaluation& evaluation);

struct CountOf {
  std::size_t count = 0, of = 0;
  std::string text() const;                    // "5 of 40"
  std::pair<double, double> interval() const;  // of 95 % (Wilson 1927)
};
// These are the records of which it is true, among those that define the metric.
CountOf count_of(const std::vector<MapScores>& scores, Metric metric);
CountOf kept_intervals(const Evaluation& evaluation);  // bodies within what was stated

using Pairs = std::vector<std::pair<double, double>>;
// It gives for at most 200 of the values which share of all, in per cent, is not above it.
Pairs shares_below(std::vector<double> values);

// Lists of blocks, empty where there is nothing to say.
Json first_table(const Report& report);
Json all_table(const Report& report);
Json beside_paper(const Report& report);  // SSIM beside that of the paper
Json cost_table(const Report& report);
Json live_table(const Report& report);
Json labels_table(const ModeResult& subject);  // scores by label
Json failures(const Report& report);
Json comparison(const Report& report);
Json errors(const Report& report);  // against range and side; distributions
Json losses(const Report& report);  // while training

// A record of the page's list: titles, what was measured, truth and maps. Depths are in millimetres
// of 16 bits, deviations in centimetres and shares in 1/200 of 8.
Json json_of(const ShownRecord& shown);
// This is what the model says of its map; `named`: one of several models.
std::string words_of(const ShownMap& map, bool named);
// Everything that the page says and shows.
Json page_of(const Report& report);

}  // namespace echofuse::recon

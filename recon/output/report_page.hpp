// SPDX-License-Identifier: MIT
// Parts of the page of a report, as text, HTML and drawings.
#pragma once
#include <string>
#include <vector>

#include "recon/output/report.hpp"

namespace echofuse::recon {

std::string short_name(const ModeResult& mode);
std::string title_of(const ModeResult& mode);  // "both sensors, factorised"
std::string name_for_charts(const ModeResult& mode);
int colour_of(const Report& report, std::size_t mode);  // of its series
const char* baseline_title(const std::string& name);
std::string three_digits(double value);  // "103 k"

// What the page says first: how good, against what, and in what it is worse.
std::string verdict(const Report& report);
// What fails, in sentences, the gravest first: of the scored run, of the letters, of the live run.
struct Problem {
  std::string text;
  bool live = false;
};
std::vector<Problem> problems_of(const Report& report);
// What there is to say that is no failure: a run like the training, corrections.
std::vector<std::string> remarks_of(const Evaluation& evaluation);

struct CountOf {
  std::size_t count = 0, of = 0;
  std::string text() const;                    // "5 of 40"
  std::pair<double, double> interval() const;  // of 95 % (Wilson 1927)
};
// Of the records that define the metric, those of which it is true.
CountOf count_of(const std::vector<MapScores>& scores, Metric metric);
CountOf kept_intervals(const Evaluation& evaluation);  // bodies within what was stated

std::string first_table(const Report& report);
std::string all_table(const Report& report);
std::string paper_html(const Report& report);  // SSIM beside that of the paper
std::string cost_table(const Report& report);
std::string live_table(const Report& report);
std::string labels_html(const ModeResult& subject);  // scores by label
std::string failures_html(const Report& report);
std::string comparison_html(const Report& report);

std::string stand_alone(const ShownRecord& shown, const chart::Span& span);  // as a file
std::string maps_alone(const ShownRecord& shown, const chart::Span& span);   // truth and maps only
// What the models leave open: from one sensor a body and its mirror image.
std::string blur_alone(const ShownRecord& shown, const chart::Span& span);  // as a file
// Truth, the subject's map and its error, and what marks in maps mean.
std::string first_html(const ShownRecord& shown, const chart::Span& span);
// With all that was measured, and all models.
std::string record_html(const ShownRecord& shown, const chart::Span& span, bool one_sensor);
std::string gallery_html(const std::vector<ShownRecord>& gallery, const chart::Span& span);
std::string errors_html(const Report& report);     // against range and side; distributions
std::string losses_html(const Report& report);     // while training
std::string cloud_html(const ShownRecord& shown);  // the place for the points in space
std::string cloud_script(const ShownRecord& shown, const chart::Span& span);  // what fills it

}  // namespace echofuse::recon

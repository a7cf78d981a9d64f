// SPDX-License-Identifier: MIT
// What fails, and which records these are; two models record by record.
#include <algorithm>
#include <cmath>
#include <map>

#include "drivers/chart/page.hpp"
#include "drivers/chart/style.hpp"
#include "recon/files/text.hpp"
#include "recon/output/report_page.hpp"

namespace echofuse::recon {
namespace {

std::string some_records(const std::vector<std::int64_t>& indices) {
  constexpr std::size_t most = 8;
  std::string out;
  for (std::size_t i = 0; i < std::min(most, indices.size()); ++i)
    out += (i ? ", " : "") + std::to_string(indices[i]);
  return out + (indices.size() > most ? ", ..." : "");
}

std::string words(const std::string& text) { return "<span class=\"words\">" + text + "</span>"; }

struct Failure {
  std::string what;
  std::vector<std::int64_t> records = {};
  std::size_t of = 0;  // that define it
};

std::vector<Failure> failures_of(const ModeResult& mode) {
  const Evaluation& e = mode.evaluations.front();
  const std::size_t all = e.scores.size();
  std::vector<Failure> out{{"the body is missed (IoU below 0.2)"},
                           {"the body stands on the wrong side (of those off the axis)"},
                           {"more than 30 cm off to the side"},
                           {"farther off than it states (10 % should be)"},
                           {"the letter is not read"}};
  const auto judge = [](Failure& f, double value, bool fails, std::int64_t index) {
    if (std::isnan(value)) return;
    ++f.of;
    if (fails) f.records.push_back(index);
  };
  std::map<std::string, std::vector<std::int64_t>> flags;
  for (std::size_t i = 0; i < all; ++i) {
    const MapScores& s = e.scores[i];
    const std::int64_t index = mode.records[i].index;
    judge(out[0], s[metric_iou], s[metric_iou] < 0.2, index);
    judge(out[1], s[metric_left_right], s[metric_left_right] < 0.5, index);
    judge(out[2], s[metric_lateral_m], s[metric_lateral_m] > 0.3, index);
    judge(out[4], s[metric_letter_top1], s[metric_letter_top1] <= 0.5, index);
    if (i >= e.uncertainties.size()) continue;
    const PredictionUncertainty& u = e.uncertainties[i];
    judge(out[3], s[metric_lateral_m] + u.lateral_interval_90_m,
          s[metric_lateral_m] > u.lateral_interval_90_m, index);
    if (!u.out_of_distribution.reason.empty())
      flags["flagged as unlike the training: " + u.out_of_distribution.reason].push_back(index);
  }
  std::erase_if(out, [](const Failure& f) { return f.of == 0; });
  for (auto& [what, records] : flags) out.push_back({what, std::move(records), all});
  std::stable_sort(out.begin(), out.end(), [](const Failure& a, const Failure& b) {
    return a.records.size() * b.of > b.records.size() * a.of;
  });
  return out;
}

std::string failures_table(const ModeResult& subject) {
  std::vector<chart::TableRow> rows;
  for (const Failure& f : failures_of(subject)) {
    const CountOf count{f.records.size(), f.of};
    const auto [low, high] = count.interval();
    rows.push_back(
        {{chart::escaped(f.what), count.text(), formatted("%.0f to %.0f %%", 100 * low, 100 * high),
          words(f.records.empty() ? "\u2013" : some_records(f.records))}});
  }
  return chart::table(title_of(subject), {"what", "records", "95 % interval", "which"}, rows);
}

// Records one by one, and the run as a whole.
std::string stated_table(const Report& report) {
  std::vector<chart::TableRow> rows;
  const auto add = [&](const std::string& name, const Evaluation& e) {
    const std::string whole = !e.domain_shift.tested() ? "not tested"
                              : e.domain_shift.found() ? "<b class=\"bad\">unlike</b>"
                                                       : "like it";
    if (!e.calibration) {
      rows.push_back({{chart::escaped(name), "not calibrated", "\u2013", "\u2013", "\u2013",
                       "\u2013", whole}});
      return;
    }
    const UncertaintyCalibration& c = *e.calibration;
    const auto cell = [](const char* form, double value) {
      return std::isnan(value) ? std::string("\u2013") : formatted(form, value);
    };
    const CountOf kept = kept_intervals(e),
                  flagged{static_cast<std::size_t>(
                              std::lround(c.flagged * static_cast<double>(e.records))),
                          e.records};
    const bool broken = kept.of > 0 && kept.interval().second < 0.9;
    const std::string held = kept.of > 0 ? kept.text() : "\u2013";
    rows.push_back({{chart::escaped(name), cell("%.1f", 100 * c.lateral_interval_90_m),
                     broken ? "<b class=\"bad\">" + held + "</b>" : held,
                     cell("%.2f", c.deviation_m), cell("%.2f", c.error_m), flagged.text(), whole}});
  };
  for (const auto& mode : report.modes) add(title_of(mode), mode.evaluations.front());
  if (report.live) add("recorded run: " + title_of(report.modes.front()), *report.live);
  return chart::table("How sure the models are, and how that holds",
                      {"", "stated: within (cm, 90 %)", "bodies within it",
                       "stated uncertainty of a pixel (m, rms)", "error of a pixel (m, rms)",
                       "records flagged one by one", "the run as a whole against the training"},
                      rows);
}

const char* words_of(Metric metric) {
  switch (metric) {
    case metric_iou:
      return "IoU";
    case metric_lateral_m:
      return "lateral error (m)";
    case metric_depth_mae_m:
      return "depth error (m)";
    case metric_ssim_fg:
      return "SSIM near the body";
    case metric_ssim_hard:
      return "SSIM, hard map";
    case metric_rmse_m:
      return "RMSE (m)";
    default:
      return metric_names[metric];
  }
}

// Share of the records below each difference.
std::string differences_chart(const Report& report) {
  std::vector<std::string> drawings;
  for (const auto& [metric, name, unit] :
       {std::tuple{metric_iou, "difference of IoU", 1.0},
        {metric_lateral_m, "difference of the lateral error (cm)", 100.0}}) {
    std::vector<double> values;
    for (const MapScores& s : report.paired)
      if (!std::isnan(s[metric])) values.push_back(unit * s[metric]);
    std::sort(values.begin(), values.end());
    chart::Panel panel{
        formatted("Record by record, second minus first (%zu records)", values.size()),
        {name},
        {"records below (%)", false, 0, 100},
        {{"", {}, chart::of_both, chart::Look::steps}},
        {{0, "equal", true}}};
    panel.width = 560, panel.height = 320;
    for (std::size_t i = 0; i < values.size(); ++i)
      panel.series[0].points.push_back(
          {values[i], 100.0 * static_cast<double>(i + 1) / static_cast<double>(values.size())});
    drawings.push_back(chart::for_both_widths(panel));
  }
  return chart::figure(drawings, "");
}

}  // namespace

std::string failures_html(const Report& report) {
  if (report.modes.empty()) return {};
  std::string out;
  for (const Problem& p : problems_of(report)) out += "<li>" + chart::escaped(p.text) + "</li>";
  if (!out.empty()) out = "<div class=\"fail\"><ul>" + out + "</ul></div>\n";
  out += failures_table(report.modes.front()) + stated_table(report);
  for (const std::string& text : remarks_of(report.modes.front().evaluations.front()))
    out += chart::paragraph("Scored run: " + text + ".");
  if (report.live)
    for (const std::string& text : remarks_of(*report.live))
      out += chart::paragraph("Recorded run: " + text + ".");
  return out;
}

std::string comparison_html(const Report& report) {
  if (report.differences.empty()) return {};
  const std::string a = title_of(report.modes[0]), b = title_of(report.modes[1]);
  std::vector<chart::TableRow> rows;
  for (const PairedDifference& d : report.differences) {
    const bool less_is_better = d.metric == metric_lateral_m || d.metric == metric_depth_mae_m ||
                                d.metric == metric_rmse_m || d.metric == metric_ghost;
    const bool open = d.low <= 0 && d.high >= 0;
    const bool second = (d.mean > 0) != less_is_better;
    rows.push_back({{words_of(d.metric), std::to_string(d.records), formatted("%.3f", d.first),
                     formatted("%.3f", d.second), formatted("%+.3f", d.mean),
                     formatted("%+.3f to %+.3f", d.low, d.high),
                     open     ? "not told apart"
                     : second ? "<b class=\"good\">second</b>"
                              : "<b class=\"good\">first</b>"}});
  }
  return chart::paragraph("First: " + a + ". Second: " + b + ".") +
         chart::table(
             "Second minus first on the same records; intervals of 95 % by resampled blocks of ten "
             "neighbours",
             {"metric", "records", "first", "second", "difference", "95 % interval", "better"},
             rows) +
         differences_chart(report);
}

}  // namespace echofuse::recon

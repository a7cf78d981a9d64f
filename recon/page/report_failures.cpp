// SPDX-License-Identifier: MIT
// This is what fails, and which records these are; two models record by record.
#include <algorithm>
#include <cmath>
#include <map>

#include "recon/numbers/text.hpp"
#include "recon/page/report_page.hpp"

namespace echofuse::recon {
namespace {

std::string some_records(const std::vector<std::int64_t>& indices) {
  constexpr std::size_t most = 8;
  std::string out;
  for (std::size_t i = 0; i < std::min(most, indices.size()); ++i)
    out += (i ? ", " : "") + std::to_string(indices[i]);
  return out + (indices.size() > most ? ", ..." : "");
}

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
                           {"farther off than it states (10 % should be)"}};
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

Json failures_table(const ModeResult& subject) {
  Json rows = Json::array();
  for (const Failure& f : failures_of(subject)) {
    const CountOf count{f.records.size(), f.of};
    const auto [low, high] = count.interval();
    rows.push_back({f.what, count.text(), formatted("%.0f to %.0f %%", 100 * low, 100 * high),
                    f.records.empty() ? "\u2013" : some_records(f.records)});
  }
  return table(title_of(subject), {"what", "records", "95 % interval", words("which")}, rows);
}

Json stated_row(const std::string& name, const Evaluation& e) {
  const Json whole = !e.domain_shift.tested() ? Json("not tested")
                     : e.domain_shift.found() ? cell("unlike", "", "bad")
                                              : Json("like it");
  const std::string none = "\u2013";
  if (!e.calibration) return {name, "not calibrated", none, none, none, none, whole};
  const UncertaintyCalibration& c = *e.calibration;
  const auto number = [&](const char* form, double value) {
    return std::isnan(value) ? none : formatted(form, value);
  };
  const CountOf kept = kept_intervals(e), flagged{static_cast<std::size_t>(std::lround(
                                                      c.flagged * static_cast<double>(e.records))),
                                                  e.records};
  const bool broken = kept.of > 0 && kept.interval().second < 0.9;
  return {name,
          number("%.1f", 100 * c.lateral_interval_90_m),
          cell(kept.of > 0 ? kept.text() : none, "", broken ? "bad" : ""),
          number("%.2f", c.deviation_m),
          number("%.2f", c.error_m),
          flagged.text(),
          whole};
}

// Records one by one, and the run as a whole.
Json stated_table(const Report& report) {
  Json rows = Json::array();
  for (const auto& mode : report.modes)
    rows.push_back(stated_row(title_of(mode), mode.evaluations.front()));
  if (report.live)
    rows.push_back(stated_row("recorded run: " + title_of(report.modes.front()), *report.live));
  return table("How sure the models are, and how that holds",
               {"", "stated: within (cm, 90 %)", "bodies within it",
                "stated uncertainty of a pixel (m, rms)", "error of a pixel (m, rms)",
                "records flagged one by one", "the run as a whole against the training"},
               rows);
}

// Share of the records below each gain.
Json differences_charts(const Report& report) {
  std::vector<Json> out;
  for (const auto& [metric, name, unit] :
       {std::tuple{metric_iou, "gain of IoU", 1.0},
        {metric_lateral_m, "gain: lateral error that is less (cm)", 100.0}}) {
    std::vector<double> values;
    for (const MapScores& s : report.paired)
      if (!std::isnan(s[metric])) values.push_back(unit * s[metric]);
    const auto better =
        std::count_if(values.begin(), values.end(), [](double gain) { return gain > 0; });
    Json one = chart(formatted("Record by record (%zu records)", values.size()), name,
                     "records below (%)");
    add_series(one, "all records", "both", Look::steps, shares_below(values));
    add_rule(one, 0, "equal");
    one["span"] = {0, 100};
    one["note"] =
        formatted("Right of the line the second is better: %s.",
                  CountOf{static_cast<std::size_t>(better), values.size()}.text().c_str());
    out.push_back(one);
  }
  return charts(out);
}

}  // namespace

Json failures(const Report& report) {
  Json out = Json::array();
  std::vector<std::string> all;
  for (const Problem& p : problems_of(report)) all.push_back(p.text);
  if (!all.empty()) out.push_back(fails(all));
  out.push_back(failures_table(report.modes.front()));
  out.push_back(stated_table(report));
  for (const std::string& text : remarks_of(report.modes.front().evaluations.front()))
    out.push_back(paragraph("Scored run: " + text + "."));
  if (report.live)
    for (const std::string& text : remarks_of(*report.live))
      out.push_back(paragraph("Recorded run: " + text + "."));
  return out;
}

Json comparison(const Report& report) {
  Json rows = Json::array();
  if (report.differences.empty()) return rows;
  for (const PairedDifference& d : report.differences) {
    const MetricWords& words = words_of(d.metric);
    const auto signed_text = [&](double v) {
      return formatted("%s%s", v < 0 ? "" : "+", words.text(v, 1).c_str());
    };
    rows.push_back({words.title(), std::to_string(d.records), words.text(d.first, 1),
                    words.text(d.second, 1), signed_text(d.mean),
                    signed_text(d.low) + " to " + signed_text(d.high),
                    d.low <= 0 && d.high >= 0 ? Json("not told apart")
                                              : cell(d.mean > 0 ? "second" : "first", "", "good")});
  }
  return Json::array(
      {paragraph("First: " + title_of(report.modes[0]) + ". Second: " + title_of(report.modes[1]) +
                 "."),
       table("The same records; intervals of 95 % by resampled blocks of ten neighbours",
             {"metric", "records", "first", "second", cell("difference", "plus: second is better"),
              "95 % interval", "better"},
             rows),
       differences_charts(report)});
}

}  // namespace echofuse::recon

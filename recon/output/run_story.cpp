// SPDX-License-Identifier: MIT
#include "recon/output/run_story.hpp"

#include <algorithm>
#include <array>

#include "drivers/chart/page.hpp"
#include "drivers/chart/style.hpp"
#include "recon/files/text.hpp"

namespace echofuse::recon {
namespace {

using record::RecordOutline;

struct Shown {
  Sensor sensor;
  const char *name, *unit;
};
constexpr std::array sensors{Shown{Sensor::spd, "detector", "clicks"},
                             Shown{Sensor::radar, "radar", "frames"},
                             Shown{Sensor::depth, "camera", "frames"}};
constexpr std::size_t most_points = 400;  // of a curve: more cannot be seen

class Clock {
 public:
  explicit Clock(const std::vector<RecordOutline>& all) : start_(all.front().slot_utc) {
    const double whole_s = at_s(all.back());
    unit_ = whole_s > 7200 ? 3600 : whole_s > 180 ? 60 : 1;
  }
  double at(const RecordOutline& o) const { return at_s(o) / unit_; }
  std::string title() const {
    return unit_ == 1 ? "time (s)" : unit_ == 60 ? "time (min)" : "time (h)";
  }

 private:
  double at_s(const RecordOutline& o) const {
    return std::chrono::duration<double>(o.slot_utc - start_).count();
  }
  UtcTime start_;
  double unit_ = 1;
};

// Stretches in which all is well as lines; where it is not, crosses.
chart::Panel presence(const RunStory& story, const Clock& clock) {
  chart::Panel panel{"Which sensors each record has", {clock.title()}, {""}, {}};
  panel.note = "Squares: records without the sensor.";
  for (std::size_t s = 0; s < sensors.size(); ++s) {
    const double y = static_cast<double>(sensors.size() - 1 - s);
    panel.y.ticks.emplace_back(y, sensors[s].name);
    chart::Series there{"", {}, 2, chart::Look::line}, lacking{"", {}, 1, chart::Look::markers};
    bool before = false;
    for (const RecordOutline& o : story.outlines) {
      const bool has = o.valid.contains(sensors[s].sensor);
      const double t = clock.at(o);
      if (!has) {
        if (before) there.points.push_back({chart::nan, y});
        if (lacking.points.size() < most_points) lacking.points.push_back({t, y});
      } else if (there.points.size() > 1 && before &&
                 !std::isnan(there.points[there.points.size() - 2].x)) {
        there.points.back().x = t;
      } else {
        there.points.push_back({t, y});
      }
      before = has;
    }
    panel.series.push_back(there), panel.series.push_back(lacking);
  }
  panel.y.first = -0.5, panel.y.last = static_cast<double>(sensors.size()) - 0.5;
  panel.height = 220;
  return panel;
}

// The mean of neighbours, so that no curve has more points than can be seen.
template <class Value>
chart::Series curve(const RunStory& story, const Clock& clock, const std::string& name, int colour,
                    const Value& value) {
  chart::Series out{name, {}, colour, chart::Look::line};
  const std::size_t step = story.outlines.size() / most_points + 1;
  for (std::size_t first = 0; first < story.outlines.size(); first += step) {
    double sum = 0, count = 0;
    for (std::size_t i = first; i < std::min(first + step, story.outlines.size()); ++i) {
      const double v = value(story.outlines[i]);
      if (!std::isnan(v)) sum += v, ++count;
    }
    out.points.push_back({clock.at(story.outlines[first]), count > 0 ? sum / count : chart::nan});
  }
  return out;
}

void add_curves(std::vector<chart::Panel>& panels, chart::Panel panel, const RunStory& story,
                const Clock& clock, double (*value)(const RecordOutline&, Sensor)) {
  bool any = false;
  for (std::size_t s = 0; s < sensors.size(); ++s) {
    const Sensor sensor = sensors[s].sensor;
    panel.series.push_back(curve(story, clock, sensors[s].name, static_cast<int>(s),
                                 [&](const RecordOutline& o) { return value(o, sensor); }));
    for (const auto& p : panel.series.back().points) any |= p.y > 0;
  }
  if (any) panels.push_back(panel);
}

std::string count(std::int64_t n) { return std::to_string(n); }

std::string sensor_table(const RunStory& story) {
  std::vector<chart::TableRow> rows;
  for (const Shown& s : sensors) {
    std::string verdicts;
    for (const auto& [verdict, records] : story.summary.verdicts[s.sensor])
      if (verdict != "ok")
        verdicts += (verdicts.empty() ? "" : "; ") + count(records) + " " + verdict;
    rows.push_back(
        {{s.name, count(story.summary.valid[s.sensor]),
          count(story.summary.records - story.summary.valid[s.sensor]),
          count(story.summary.lost[s.sensor]) + " " + (s.sensor == Sensor::spd ? "tags" : "frames"),
          "<span class=\"words\">" + (verdicts.empty() ? "-" : chart::escaped(verdicts)) +
              "</span>"}});
  }
  return chart::table("", {"sensor", "records with it", "without", "lost on the way", "why not"},
                      rows);
}

std::string label_table(const RunStory& story) {
  if (story.summary.labels.size() < 2) return {};
  std::vector<chart::TableRow> rows;
  for (const auto& [label, records] : story.summary.labels)
    rows.push_back({{label.empty() ? "(none)" : chart::escaped(label), count(records)}});
  return chart::details("Labels", chart::table("", {"label", "records"}, rows));
}

std::string event_table(const RunStory& story) {
  if (story.events.empty()) return {};
  constexpr std::size_t most = 200;
  std::vector<chart::TableRow> rows;
  for (const auto& e : story.events)
    if (rows.size() < most)
      rows.push_back({{chart::escaped(e.utc), chart::escaped(e.level), chart::escaped(e.source),
                       chart::escaped(e.text)}});
  return chart::details(formatted("Events (%zu)", story.events.size()),
                        chart::table("", {"UTC", "level", "source", "what"}, rows));
}

}  // namespace

RunStory story_of(const std::string& path) {
  const record::RunReader run(path);
  return {path, run.info(), run.summary(), run.events(), run.outlines(0)};
}

std::string verdict_of(const RunStory& story) {
  const auto& s = story.summary;
  std::string out = formatted("%s: %lld record%s", story.info.status.c_str(),
                              static_cast<long long>(s.records), s.records == 1 ? "" : "s");
  if (s.records == 0) return out;
  out += s.all_valid == s.records ? ", all with all three sensors"
                                  : formatted(", of which %lld have all three sensors",
                                              static_cast<long long>(s.all_valid));
  if (s.incomplete > 0)
    out += formatted("; %lld lack a sensor that the run requires",
                     static_cast<long long>(s.incomplete));
  return out + ".";
}

std::vector<chart::Panel> timeline(const RunStory& story) {
  if (story.outlines.empty()) return {};
  const Clock clock(story.outlines);
  std::vector<chart::Panel> out{presence(story, clock)};
  add_curves(out,
             {"What went into a record", {clock.title()}, {"clicks or frames a record", true}, {}},
             story, clock,
             [](const RecordOutline& o, Sensor s) { return static_cast<double>(o.sync[s].used); });
  add_curves(out, {"What was lost", {clock.title()}, {"tags or frames a record"}, {}}, story, clock,
             [](const RecordOutline& o, Sensor s) { return static_cast<double>(o.sync[s].lost); });
  add_curves(out, {"How well the clocks are known", {clock.title()}, {"residual (ms)", true}, {}},
             story, clock, [](const RecordOutline& o, Sensor s) {
               const auto& residual = o.clock_residual_s[s];
               return residual ? 1e3 * *residual : chart::nan;
             });
  return out;
}

std::string story_html(const RunStory& story) {
  std::vector<std::string> drawings;
  for (chart::Panel p : timeline(story)) {
    p.width = 560;
    drawings.push_back(chart::draw(p).svg);
  }
  std::string out = chart::paragraph(story.path + ": " + verdict_of(story));
  if (!drawings.empty()) out += chart::figure(drawings, "");
  return out + sensor_table(story) + label_table(story) + event_table(story);
}

}  // namespace echofuse::recon

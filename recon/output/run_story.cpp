// SPDX-License-Identifier: MIT
#include "recon/output/run_story.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "drivers/chart/page.hpp"
#include "drivers/chart/style.hpp"
#include "recon/files/text.hpp"

namespace echofuse::recon {
namespace {

using record::RecordOutline;

struct Shown {
  Sensor sensor;
  const char *name, *unit;
  int colour;
};
constexpr std::array sensors{Shown{Sensor::spd, "SPD", "clicks", chart::of_spd},
                             Shown{Sensor::radar, "radar", "frames", chart::of_radar},
                             Shown{Sensor::depth, "depth camera", "frames", chart::of_camera}};
constexpr std::size_t most_points = 400;  // of a curve: more cannot be seen

class Clock {
 public:
  explicit Clock(const std::vector<RecordOutline>& all) : start_(all.front().slot_utc) {
    const double whole_s = at_s(all.back());
    unit_ = whole_s > 7200 ? 3600 : whole_s > 180 ? 60 : 1;
    end_ = (whole_s + std::chrono::duration<double>(all.back().length).count()) / unit_;
  }
  double at(const RecordOutline& o) const { return at_s(o) / unit_; }
  double end() const { return end_; }
  std::string unit() const { return unit_ == 1 ? "s" : unit_ == 60 ? "min" : "h"; }

 private:
  double at_s(const RecordOutline& o) const {
    return std::chrono::duration<double>(o.slot_utc - start_).count();
  }
  UtcTime start_;
  double unit_ = 1, end_ = 1;
};

// Stretches of records without the sensor. More of them than can be seen are left out: the
// shortest.
std::vector<chart::Band> gaps(const RunStory& story, const Clock& clock, Sensor sensor) {
  std::vector<chart::Band> out;
  bool open = false;
  for (const RecordOutline& o : story.outlines) {
    const bool lacks = !o.valid.contains(sensor);
    if (lacks && !open) out.push_back({clock.at(o), 0, "no data"});
    if (!lacks && open) out.back().last = clock.at(o);
    open = lacks;
  }
  if (open) out.back().last = clock.end();
  if (out.size() > most_points) {
    std::stable_sort(out.begin(), out.end(), [](const auto& a, const auto& b) {
      return a.last - a.first > b.last - b.first;
    });
    out.resize(most_points);
    std::stable_sort(out.begin(), out.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
  }
  return out;
}

// A strip: the same room at its sides as the others.
chart::Panel strip(const std::string& title, const std::string& unit, const Clock& clock,
                   double width) {
  chart::Panel out{title, {"", false, 0, clock.end()}, {unit}, {}};
  out.width = width, out.height = 104, out.left = 72, out.right = 20, out.bare = true;
  return out;
}

// Neighbours as one point, so that no curve has more than can be seen: their mean, or their sum.
template <class Value>
chart::Series curve(const RunStory& story, const Clock& clock, int colour, bool sum,
                    const Value& value) {
  chart::Series out{"", {}, colour, sum ? chart::Look::stems : chart::Look::line};
  const std::size_t step = story.outlines.size() / most_points + 1;
  for (std::size_t first = 0; first < story.outlines.size(); first += step) {
    double all = 0, count = 0;
    for (std::size_t i = first; i < std::min(first + step, story.outlines.size()); ++i) {
      const double v = value(story.outlines[i]);
      if (!std::isnan(v)) all += v, ++count;
    }
    out.points.push_back({clock.at(story.outlines[first]), count == 0 ? chart::nan
                                                           : sum      ? all
                                                                      : all / count});
  }
  return out;
}

double most_of(const chart::Series& s) {
  double most = 0;
  for (const auto& p : s.points)
    if (!std::isnan(p.y)) most = std::max(most, p.y);
  return most;
}

chart::Panel samples(const RunStory& story, const Clock& clock, const Shown& s, double width) {
  chart::Panel out = strip(std::string(s.name) + ": " + s.unit + " a record", s.unit, clock, width);
  out.series = {curve(story, clock, s.colour, false, [&](const RecordOutline& o) {
    return o.valid.contains(s.sensor) ? static_cast<double>(o.sync[s.sensor].used) : chart::nan;
  })};
  out.y.first = 0, out.y.last = std::max(1.2 * most_of(out.series[0]), 4.0);
  out.bands = gaps(story, clock, s.sensor);
  return out;
}

// Stems with counts; nothing at all for a sensor that lost nothing.
chart::Panel losses(const RunStory& story, const Clock& clock, const Shown& s, double width) {
  const char* unit = s.sensor == Sensor::spd ? "tags" : "frames";
  chart::Panel out = strip(std::string(s.name) + ": " + unit + " lost in a record, " +
                               std::to_string(story.summary.lost[s.sensor]) + " in all",
                           unit, clock, width);
  out.series = {curve(story, clock, s.colour, true, [&](const RecordOutline& o) {
    const auto lost = static_cast<double>(o.sync[s.sensor].lost);
    return lost > 0 ? lost : chart::nan;
  })};
  out.y.first = 0, out.y.last = std::max(1.5 * most_of(out.series[0]), 4.0);
  out.bands = gaps(story, clock, s.sensor);
  std::erase_if(out.series[0].points, [](const auto& p) { return std::isnan(p.y); });
  if (constexpr std::size_t most_labels = 25; out.series[0].points.size() <= most_labels)
    for (auto& p : out.series[0].points) p.label = chart::short_number(p.y);
  return out;
}

chart::Panel residuals(const RunStory& story, const Clock& clock, const Shown& s, double width) {
  chart::Panel out = strip(std::string(s.name) + ": residual of its clock's fit (\u00b5s)",
                           "\u00b5s", clock, width);
  out.series = {curve(story, clock, s.colour, false, [&](const RecordOutline& o) {
    const auto& residual = o.clock_residual_s[s.sensor];
    return residual && o.valid.contains(s.sensor) ? 1e6 * *residual : chart::nan;
  })};
  out.y.first = 0, out.y.last = std::max(1.3 * most_of(out.series[0]), 1.0);
  out.bands = gaps(story, clock, s.sensor);
  return out;
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
          "<span class=\"words\">" + (verdicts.empty() ? "\u2013" : chart::escaped(verdicts)) +
              "</span>"}});
  }
  return chart::table("",
                      {"sensor", "records with it", "records without", "lost in records",
                       "why a record is without"},
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

std::vector<std::string> gone_sensors(const RunStory& story) {
  std::vector<std::string> out;
  if (story.outlines.empty()) return out;
  const Clock clock(story.outlines);
  std::map<std::string, std::string> by_time;  // sensors that go at the same time
  for (const Shown& s : sensors) {
    const std::int64_t lacking = story.summary.records - story.summary.valid[s.sensor];
    const auto all = gaps(story, clock, s.sensor);
    const bool never = lacking == story.summary.records;
    if (lacking == 0 || never) continue;  // never there: not of this run
    if (!all.empty() && all.back().last == clock.end()) {
      std::string& names = by_time[formatted("%.4g %s", all.back().first, clock.unit().c_str())];
      names += (names.empty() ? "" : ", ") + std::string(s.name);
    } else if (lacking * 20 > story.summary.records) {
      out.push_back(formatted("%lld of %lld records lack the %s.", static_cast<long long>(lacking),
                              static_cast<long long>(story.summary.records), s.name));
    }
  }
  for (const auto& [time, names] : by_time)
    out.push_back("no data of " + names + " from " + time + " to the end.");
  return out;
}

chart::Drawing timeline(const RunStory& story, double width) {
  const Clock clock(story.outlines);
  std::vector<chart::Panel> panels;
  for (const Shown& s : sensors)
    if (story.summary.valid[s.sensor] > 0) panels.push_back(samples(story, clock, s, width));
  for (const Shown& s : sensors)
    if (story.summary.lost[s.sensor] > 0) panels.push_back(losses(story, clock, s, width));
  for (const Shown& s : sensors)
    if (const auto panel = residuals(story, clock, s, width); most_of(panel.series[0]) > 0)
      panels.push_back(panel);
  if (panels.empty()) return {};
  panels.back().bare = false, panels.back().height += 34;
  panels.back().x.title = "time (" + clock.unit() + ")";
  std::vector<chart::Drawing> drawings;
  for (const chart::Panel& p : panels) drawings.push_back(chart::draw(p));
  return chart::stacked(drawings);
}

std::string story_html(const RunStory& story, const std::string& between) {
  std::string out =
      chart::paragraph(story.path + ": " + verdict_of(story)) + between + sensor_table(story);
  if (!story.outlines.empty())
    if (const auto wide = timeline(story, 1100); wide.height > 0)
      out += chart::figure({chart::for_both_widths(wide, timeline(story, chart::narrow_px))}, "");
  return out + label_table(story) + event_table(story);
}

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include "recon/page/run_story.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "recon/numbers/text.hpp"

namespace echofuse::recon {
namespace {

using record::FusedRecord;

struct Shown {
  Sensor sensor;
  const char *key, *name;
};
constexpr std::array sensors{Shown{Sensor::spd, "spd", "SPD"},
                             Shown{Sensor::radar, "radar", "radar"},
                             Shown{Sensor::depth, "depth", "depth camera"}};
constexpr std::size_t most_points = 400;  // of a curve: more cannot be seen

class Clock {
 public:
  explicit Clock(const std::vector<FusedRecord>& all) : start_(all.front().slot_utc) {
    const double whole_s = at_s(all.back());
    unit_ = whole_s > 7200 ? 3600 : whole_s > 180 ? 60 : 1;
    end_ = (whole_s + seconds(all.back().slot_end - all.back().slot_start)) / unit_;
  }
  double at(const FusedRecord& o) const { return at_s(o) / unit_; }
  double end() const { return end_; }
  std::string unit() const { return unit_ == 1 ? "s" : unit_ == 60 ? "min" : "h"; }

 private:
  double at_s(const FusedRecord& o) const {
    return std::chrono::duration<double>(o.slot_utc - start_).count();
  }
  UtcTime start_;
  double unit_ = 1, end_ = 1;
};

struct Gap {
  double first = 0, last = 0;
};
// Stretches of records without the sensor. More of them than can be seen are left out: the
// shortest.
std::vector<Gap> gaps(const RunStory& story, const Clock& clock, Sensor sensor) {
  std::vector<Gap> out;
  bool open = false;
  for (const FusedRecord& o : story.outlines) {
    const bool lacks = !o.valid.contains(sensor);
    if (lacks && !open) out.push_back({clock.at(o), 0});
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

// Neighbours as one point, so that no curve has more than can be seen: their mean, or their sum;
// null without any.
template <class Value>
Json curve(const RunStory& story, bool sum, const Value& value) {
  Json out = Json::array();
  const std::size_t step = story.outlines.size() / most_points + 1;
  for (std::size_t first = 0; first < story.outlines.size(); first += step) {
    double all = 0, count = 0;
    for (std::size_t i = first; i < std::min(first + step, story.outlines.size()); ++i)
      if (const double v = value(story.outlines[i]); !std::isnan(v)) all += v, ++count;
    out.push_back(short_number(sum ? all : all / count));
  }
  return out;
}

// This is what the live page's strips take (recon/page/charts.js), and where a sensor is missing.
Json strips(const RunStory& story) {
  constexpr double none = std::numeric_limits<double>::quiet_NaN();
  const Clock clock(story.outlines);
  Json arrays{{"first", curve(story, false, [&](const auto&o) { return clock.at(o); })}},
      missing = Json::object();
  for (const Shown& s : sensors) {
    const std::string end = std::string("_") + s.key;
    const auto valid = [&](const FusedRecord& o) { return o.valid.contains(s.sensor); };
    arrays["used" + end] = curve(story, false, [&](const FusedRecord& o) {
      return valid(o) ? static_cast<double>(o.sync[s.sensor].used) : none;
    });
    arrays["lost" + end] = curve(story, true, [&](const FusedRecord& o) {
      return static_cast<double>(o.sync[s.sensor].lost);
    });
    arrays["residual_s" + end] = curve(story, false, [&](const FusedRecord& o) {
      const auto& fit = o.clocks[s.sensor];
      return fit && valid(o) ? fit->residual_s : none;
    });
    missing[s.key] = Json::array();
    for (const Gap& gap : gaps(story, clock, s.sensor))
      missing[s.key].push_back(Json::array({short_number(gap.first), short_number(gap.last)}));
  }
  return {{"kind", "strips"}, {"unit", clock.unit()}, {"end", short_number(clock.end())},
          {"arrays", arrays}, {"gaps", missing},      {"window_s", story.info.window_s}};
}

std::string count(std::int64_t n) { return std::to_string(n); }

Json sensor_table(const RunStory& story) {
  Json rows = Json::array();
  for (const Shown& s : sensors) {
    std::string verdicts;
    for (const auto& [verdict, records] : story.summary.verdicts[s.sensor])
      if (verdict != "ok")
        verdicts += (verdicts.empty() ? "" : "; ") + count(records) + " " + verdict;
    rows.push_back(
        {s.name, count(story.summary.valid[s.sensor]),
         count(story.summary.records - story.summary.valid[s.sensor]),
         count(story.summary.lost[s.sensor]) + (s.sensor == Sensor::spd ? " tags" : " frames"),
         verdicts.empty() ? "\u2013" : verdicts});
  }
  return table("",
               {"sensor", "records with it", "records without", "lost in records",
                words("why a record is without")},
               rows);
}

Json label_table(const RunStory& story) {
  Json rows = Json::array();
  for (const auto& [label, records] : story.summary.labels)
    rows.push_back({label.empty() ? "(none)" : label, count(records)});
  return details("Labels", Json::array({table("", {"label", "records"}, rows)}));
}

Json event_table(const RunStory& story) {
  constexpr std::size_t most = 200;
  Json rows = Json::array();
  for (const auto& e : story.events)
    if (rows.size() < most) rows.push_back({e.utc, e.level, e.source, e.text});
  return details(formatted("Events (%zu)", story.events.size()),
                 Json::array({table("", {"UTC", "level", words("source"), words("what")}, rows)}));
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
  if (const std::string doubts = record::doubts_of(s); !doubts.empty()) out += "; " + doubts;
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

Json story_blocks(const RunStory& story, const Json& between) {
  Json out = Json::array({paragraph(story.path + ": " + verdict_of(story))});
  for (const Json& block : between) out.push_back(block);
  out.push_back(sensor_table(story));
  if (!story.outlines.empty()) out.push_back(strips(story));
  if (story.summary.labels.size() > 1) out.push_back(label_table(story));
  if (!story.events.empty()) out.push_back(event_table(story));
  return out;
}

}  // namespace echofuse::recon

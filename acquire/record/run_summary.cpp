// SPDX-License-Identifier: MIT
#include <algorithm>

#include "acquire/record/read_rows.hpp"
#include "acquire/record/run_file.hpp"
#include "acquire/record/sqlite.hpp"

namespace echofuse::record {
namespace {

// The next columns: idx, and those of the other read_slot. Throws Error for a slot that cannot be.
void read_slot(Statement& row, const std::string& shown_path, RecordOutline& r) {
  r.index = row.integer();
  HostTime start{}, end{};
  const std::string fault = read_slot(row, start, end, r.slot_utc);
  if (!fault.empty())
    throw Error(ExitCode::failed,
                shown_path + ": record " + std::to_string(r.index) + ": " + fault);
  r.length = end - start;
}

// Whether it speaks against the record.
bool is_doubt(const std::string& kind) {
  return kind != "ok" && kind != "not configured" && !kind.empty();
}

}  // namespace

std::string verdict_kind(const std::string& verdict) {
  return verdict.substr(0, verdict.find(':'));
}

void count_verdicts(RunSummary& sum, const PerSensor<std::string>& verdicts) {
  bool doubt = false;
  for (const Sensor s : all_sensors) {
    const std::string kind = verdict_kind(verdicts[s]);
    ++sum.verdicts[s][kind];
    doubt |= is_doubt(kind);
  }
  sum.doubtful += doubt;
}

void add_part(RunSummary& sum, const RunSummary& next) {
  if (next.records == 0) return;
  if (sum.records == 0) sum.first_utc = next.first_utc;
  sum.last_utc = next.last_utc;
  sum.last_index = next.last_index;
  const auto add = [](auto& into, const auto& from) {
    for (const auto& [key, count] : from) into[key] += count;
  };
  add(sum.labels, next.labels), add(sum.events, next.events);
  for (const Sensor s : all_sensors) {
    sum.valid[s] += next.valid[s], sum.lost[s] += next.lost[s];
    add(sum.verdicts[s], next.verdicts[s]);
    if (next.clocks[s]) sum.clocks[s] = next.clocks[s];
  }
  for (const auto member :
       {&RunSummary::records, &RunSummary::all_valid, &RunSummary::incomplete,
        &RunSummary::doubtful, &RunSummary::tags, &RunSummary::arrays, &RunSummary::array_frames})
    sum.*member += next.*member;
}

std::string doubts_of(const RunSummary& sum) {
  constexpr PerSensor<const char*> names{"SPD", "radar", "camera"};
  std::string out;
  for (const Sensor s : all_sensors) {
    std::vector<std::pair<std::int64_t, std::string>> most;
    for (const auto& [kind, records] : sum.verdicts[s])
      if (is_doubt(kind)) most.emplace_back(-records, kind);
    std::sort(most.begin(), most.end());
    for (const auto& [records, kind] : most)
      out += (&kind != &most.front().second ? ", "
              : out.empty()                 ? std::string(names[s]) + " "
                                            : "; " + std::string(names[s]) + " ") +
             kind + " " + std::to_string(-records);
  }
  return out.empty() ? out
                     : std::to_string(sum.doubtful) + " of " + std::to_string(sum.records) +
                           " doubtful: " + out;
}

bool RunReader::has_table(const char* name) const {
  Statement s = ask("SELECT 1 FROM sqlite_schema WHERE name = ?");
  return s.bind(name).step();
}

RunSummary RunReader::summary() const {
  RunSummary sum;
  Statement totals = ask(
      "SELECT count(idx), total(valid & 7 = 7), total(valid & 1), total(valid >> 1 & 1), "
      "total(valid >> 2 & 1), total(spd_lost), total(radar_lost), total(depth_lost), total(tags), "
      "ifnull(max(idx), -1) FROM record");
  if (totals.step()) {
    sum.records = totals.integer();
    sum.all_valid = totals.integer();
    for (auto* three : {&sum.valid, &sum.lost})
      for (auto& n : *three) n = totals.integer();
    sum.tags = totals.integer();
    sum.last_index = totals.integer();
  }
  // Not the earliest and the latest: the clock may have been set back between them.
  Statement ends =
      ask("SELECT idx, slot_start_ns, slot_end_ns, slot_utc_ns FROM record WHERE idx IN ((SELECT "
          "min(idx) FROM record), (SELECT max(idx) FROM record)) ORDER BY idx");
  for (bool first = true; ends.step(); first = false) {
    RecordOutline r;
    read_slot(ends, shown_, r);
    if (first) sum.first_utc = r.slot_utc;
    sum.last_utc = r.slot_utc + r.length;
  }
  // Not by GROUP BY, which sorts a copy of them all.
  const auto count_by = [&](const char* sql, std::map<std::string, std::int64_t>& into) {
    Statement rows = ask(sql);
    while (rows.step()) ++into[rows.text()];
  };
  count_by("SELECT label FROM record", sum.labels);
  count_by("SELECT level FROM event", sum.events);
  Statement verdicts = ask("SELECT spd_verdict, radar_verdict, depth_verdict FROM record");
  while (verdicts.step()) {
    PerSensor<std::string> of_record;
    for (std::string& verdict : of_record) verdict = verdicts.text();
    count_verdicts(sum, of_record);
  }
  if (has_table("clock_fit")) summarise_sync(sum);
  if (has_table("radar_array")) {
    Statement arrays = ask("SELECT count(idx), total(frames) FROM radar_array");
    if (arrays.step()) {
      sum.arrays = arrays.integer();
      sum.array_frames = arrays.integer();
    }
  }
  return sum;
}

std::optional<std::string> RunReader::last_label() const {
  std::optional<std::string> label;
  std::string end;
  Statement record =
      ask("SELECT label, slot_utc_ns + slot_end_ns - slot_start_ns FROM record ORDER BY "
          "idx DESC LIMIT 1");
  if (record.step()) {
    label = record.text();
    end = iso8601(UtcTime(record.integer()));
  }
  Statement mark =
      ask("SELECT text FROM event WHERE level = 'label' AND utc >= ? ORDER BY id DESC LIMIT "
          "1");
  if (mark.bind(end).step()) label = mark.text();
  return label;
}

// Older files are without these tables.
void RunReader::summarise_sync(RunSummary& sum) const {
  Statement incomplete = ask("SELECT count(idx) FROM incomplete");
  if (incomplete.step()) sum.incomplete = incomplete.integer();
  sum.policies = policies();
  for (const Sensor s : all_sensors) {
    const std::string name = name_of(s);
    const std::string sql = "SELECT " + name + "_offset_s, " + name + "_drift_ppm, " + name +
                            "_residual_s, " + name + "_samples FROM clock_fit WHERE " + name +
                            "_samples > 0 ORDER BY idx DESC LIMIT 1";
    Statement row = ask(sql.c_str());
    if (!row.step()) continue;
    ClockState& clock = sum.clocks[s].emplace();
    clock.offset_s = row.real();
    clock.drift_ppm = row.real();
    clock.residual_s = row.real();
    clock.samples = static_cast<std::uint64_t>(row.integer());
  }
}

std::vector<RecordOutline> RunReader::outlines(std::int64_t first) const {
  std::string sql = "SELECT idx, slot_start_ns, slot_end_ns, slot_utc_ns, valid, label";
  for (const std::string s : {"spd", "radar", "depth"})
    sql +=
        ", " + s + "_offset_s, " + s + "_span_s, " + s + "_used, " + s + "_lost, " + s + "_verdict";
  const bool fitted = has_table("clock_fit");
  for (const std::string s : {"spd", "radar", "depth"})
    sql += fitted ? ", (SELECT " + s + "_residual_s FROM clock_fit f WHERE f.idx = record.idx)"
                  : ", NULL";
  Statement row = ask((sql + " FROM record WHERE idx >= ? ORDER BY idx").c_str());
  row.bind(first);
  std::vector<RecordOutline> out;
  while (row.step()) {
    RecordOutline& r = out.emplace_back();
    read_slot(row, shown_, r);
    r.valid = SensorSet::from_bits(static_cast<std::uint32_t>(row.integer()));
    r.label = row.text();
    read_sync(row, r.sync);
    for (auto& residual_s : r.clock_residual_s) {
      const bool none = row.next_is_null();
      const double value = row.real();
      if (!none) residual_s = value;
    }
  }
  return out;
}

PerSensor<std::int64_t> RunReader::late() const {
  PerSensor<std::int64_t> out{};
  if (!has_table("late")) return out;
  Statement row = ask("SELECT total(spd), total(radar), total(depth) FROM late");
  if (row.step())
    for (auto& n : out) n = row.integer();
  return out;
}

PerSensor<std::optional<std::int64_t>> RunReader::last_frames() const {
  PerSensor<std::optional<std::int64_t>> out;
  if (!has_table("slot")) return out;
  Statement last = ask("SELECT radar_frames, depth_frames FROM slot ORDER BY idx DESC LIMIT 1");
  if (last.step()) out[Sensor::radar] = last.integer(), out[Sensor::depth] = last.integer();
  return out;
}

std::vector<std::pair<std::string, int>> RunReader::radar_temperatures() const {
  std::vector<std::pair<std::string, int>> out;
  if (!has_table("radar_status")) return out;
  Statement last =
      ask("SELECT rx0_c, rx1_c, rx2_c, rx3_c, tx0_c, tx1_c, tx2_c, pm_c, dig0_c, dig1_c FROM "
          "radar_status WHERE temperature_ms IS NOT NULL ORDER BY idx DESC LIMIT 1");
  if (!last.step()) return out;
  for (const char* place : {"rx0", "rx1", "rx2", "rx3", "tx0", "tx1", "tx2", "pm", "dig0", "dig1"})
    out.emplace_back(place, static_cast<int>(std::clamp<std::int64_t>(last.integer(), -999, 999)));
  return out;
}

std::vector<Event> RunReader::last_events(std::size_t most) const {
  Statement row = ask("SELECT utc, level, source, text FROM event ORDER BY id DESC LIMIT ?");
  row.bind(most);
  std::vector<Event> out = read_events(row);
  std::reverse(out.begin(), out.end());
  return out;
}

std::string RunReader::check() const {
  Statement s = ask("PRAGMA integrity_check");
  const std::string verdict = s.step() ? s.text() : "no answer";
  return verdict == "ok" ? "" : verdict;
}

}  // namespace echofuse::record

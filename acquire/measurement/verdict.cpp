// SPDX-License-Identifier: MIT
#include "acquire/measurement/verdict.hpp"

#include <algorithm>
#include <utility>
#include <vector>

namespace echofuse::record {
namespace {

constexpr SensorSet any{Sensor::spd, Sensor::radar, Sensor::depth};
constexpr SensorSet spd{Sensor::spd}, radar{Sensor::radar}, depth{Sensor::depth};
constexpr SensorSet signals{Sensor::spd, Sensor::radar}, frames{Sensor::radar, Sensor::depth};

using enum VerdictKind;
using enum Lamp;

// Returns the row of a verdict without valid data.
constexpr VerdictRow absent(VerdictKind kind, const char* word, SensorSet sensors,
                            const char* sentence) {
  return {kind, word, sensors, false, false, false, true, look, "", sentence};
}

// Columns: kind, word, sensors, valid, trains, truth, doubtful, lamp, setting, sentence.
constexpr VerdictRow table[] = {
    {ok, "ok", any, true, true, true, false, good, "", "The data are good."},
    {not_assessed, "not assessed", radar, true, true, true, false, neutral, "",
     "The data cannot be assessed, e.g. because the range axis has too few cells."},
    {no_peak, "no peak", signals, true, true, false, true, look, "signal.radar_snr_db",
     "SPD: no 5 adjacent bins exceed their mean clearly. Radar: peak/median is below the limit."},
    {lossy, "lossy", any, true, true, true, true, look, "signal.lossy_share",
     "Fewer tags, histograms, frames or start pulses arrived than this fraction of those sent."},
    {weak, "weak", any, true, false, false, true, look,
     "signal.spd_clicks, signal.depth_share, signal.weak_share",
     "Too few clicks above the background, too few pixels with a return, or a signal much weaker "
     "than in the first minute of the run."},
    {saturated, "saturated", signals, true, false, false, true, look, "signal.clicks_per_pulse",
     "SPD: too many clicks per laser pulse (pile-up). Radar: the top of the lobe is clipped."},
    {stands_still, "stands still", any, true, false, false, true, look, "",
     "The data are identical to those of the previous record."},
    {not_configured, "not configured", any, false, false, false, false, off, "",
     "The configuration does not contain this sensor."},
    absent(missing, "missing", any, "There are no data."),
    absent(no_tags, "no tags", spd, "The tagger sent no tags."),
    absent(no_starts, "no start tags", spd, "The tagger sent no tags on the start channel."),
    absent(no_histograms, "no histograms", spd, "The detector sent no histograms."),
    absent(no_frames, "no frames", frames, "The device sent no frames."),
    absent(no_profile, "no range profile", radar,
           "The frames contain no range profile, or only zeros."),
    absent(covers_part, "covers only part", spd, "The samples cover less than half of the slot."),
    absent(in_overflow, "in overflow", spd,
           "All clicks arrived during overflows of the tagger, so none are counted."),
    absent(other_axis, "other axis", any,
           "The size or axis of the data differs from the one at the start of the run."),
    absent(odd, "odd", depth, "The values of an imported depth map are implausible."),
    absent(stood_still, "the program stood still", any,
           "The operating system suspended the program for longer than a slot."),
    {not_stored, "not stored", any, false, false, false, true, bad, "",
     "The data were dropped because the disk is too slow, or could not be stored."},
    absent(other, "other", any,
           "The verdict was written by another version; the figures contain its text."),
};

static_assert([] {
  for (std::size_t i = 0; i < std::size(table); ++i)
    if (table[i].kind != static_cast<VerdictKind>(i)) return false;
  return true;
}());

}  // namespace

std::span<const VerdictRow> verdict_table() { return table; }

std::string Verdict::text() const {
  if (kind == other) return figures.empty() ? word() : figures;
  return figures.empty() ? word() : word() + ": " + figures;
}

void Verdict::add(const Verdict& more) {
  if (more.ok()) return;
  if (ok()) return void(*this = more);
  const bool higher = more.kind > kind;
  const std::string second = (higher ? *this : more).text();
  if (higher) *this = more;
  figures += (figures.empty() ? "also " : "; also ") + second;
}

VerdictKind kind_of(std::string_view word) {
  const auto* row = std::ranges::find(table, word, &VerdictRow::word);
  return row == std::end(table) ? other : row->kind;
}

std::string state_of(bool valid, const Verdict& verdict) {
  return !valid ? "no data" : verdict.row().doubtful ? verdict.word() : "ok";
}

void VerdictCounts::add(const PerSensor<Verdict>& of_record) {
  for (const Sensor s : all_sensors) ++by_sensor[s][of_record[s].kind];
  ++records;
  doubtful += std::ranges::any_of(of_record, [](const Verdict& v) { return v.row().doubtful; });
}

std::string VerdictCounts::doubts() const {
  constexpr PerSensor<const char*> names{"SPD", "radar", "camera"};
  std::string out;
  for (const Sensor s : all_sensors) {
    std::vector<std::pair<std::int64_t, std::string>> by_count;
    for (const auto& [kind, count] : by_sensor[s])
      if (const VerdictRow& row = row_of(kind); row.doubtful)
        by_count.emplace_back(-count, row.word);
    std::sort(by_count.begin(), by_count.end());
    for (const auto& [count, word] : by_count)
      out += (&word != &by_count.front().second ? ", "
              : out.empty()                     ? std::string(names[s]) + " "
                                                : "; " + std::string(names[s]) + " ") +
             word + " " + std::to_string(-count);
  }
  return out.empty()
             ? out
             : std::to_string(doubtful) + " of " + std::to_string(records) + " doubtful: " + out;
}

}  // namespace echofuse::record

// SPDX-License-Identifier: MIT
// Verdicts on the data of a sensor in one slot. One table states for each kind of verdict where its
// data may be used and how it is shown; every program asks this table.
#pragma once
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>

#include "drivers/core/sensor.hpp"

namespace echofuse::record {

// In order of rank: if a sensor has two faults, the verdict is the one of the higher rank.
enum class VerdictKind : std::uint8_t {
  ok,
  not_assessed,
  // valid data of poor quality
  no_peak,
  lossy,
  weak,
  saturated,
  stands_still,
  // no valid data
  not_configured,
  missing,
  no_tags,
  no_starts,
  no_histograms,
  no_frames,
  no_profile,
  covers_part,
  in_overflow,
  other_axis,
  odd,
  stood_still,
  not_stored,
  other,
};

// Colour of the status indicator on the live page.
enum class Lamp : std::uint8_t { off, neutral, good, look, bad };
inline const char* name_of(Lamp lamp) {
  constexpr const char* names[] = {"off", "neutral", "ok", "look", "bad"};
  return names[static_cast<std::size_t>(lamp)];
}

struct VerdictRow {
  VerdictKind kind;
  const char* word;   // first words of the verdict in run files, JSON and tables
  SensorSet sensors;  // sensors that can get this verdict
  bool valid;         // the record contains data of the sensor
  bool trains;        // a model may use the data as an input, in training and in scoring
  bool truth;         // a model may be trained on, or scored against, this depth map
  bool doubtful;      // counts as doubtful, and calls the program alert.on_doubt
  Lamp lamp;
  const char* setting;  // key of the limit, or empty
  const char* sentence;
};

// Returns one row for each kind, in the order of VerdictKind.
std::span<const VerdictRow> verdict_table();

inline const VerdictRow& row_of(VerdictKind kind) {
  return verdict_table()[static_cast<std::size_t>(kind)];
}

struct Verdict {
  VerdictKind kind = VerdictKind::missing;
  std::string figures;  // measured values and limits; may be empty

  const VerdictRow& row() const { return row_of(kind); }
  bool ok() const { return kind == VerdictKind::ok; }
  std::string word() const { return row().word; }
  // Returns the word, followed by ": " and the figures, if there are any.
  std::string text() const;
  // Adds a second verdict on the same data. The one of the higher rank is kept; the other one is
  // appended to its figures.
  void add(const Verdict& more);
  bool operator==(const Verdict&) const = default;
};

inline const Verdict ok_verdict{VerdictKind::ok, {}};

// Returns the kind with this word; `other` for an unknown word, e.g. from a later version.
VerdictKind kind_of(std::string_view word);

// Returns the state of a sensor in a slot: "ok", the word of its doubtful verdict, or "no data".
std::string state_of(bool valid, const Verdict& verdict);

struct VerdictCounts {
  PerSensor<std::map<VerdictKind, std::int64_t>> by_sensor;  // number of records by verdict
  std::int64_t records = 0, doubtful = 0;

  void add(const PerSensor<Verdict>& of_record);
  // Returns e.g. "28 of 75 doubtful: radar no frames 11, weak 10; camera stands still 7"; empty if
  // no verdict is doubtful.
  std::string doubts() const;
};

}  // namespace echofuse::record

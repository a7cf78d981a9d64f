// SPDX-License-Identifier: MIT
// The tables of a run file, version 1. A record's blobs stand last, so that its other columns are
// read without walking through them. radar_status (of a record's last radar frame that had any,
// NULL where it had none), spd_status (of records with any such count), policy, incomplete (of
// records that lack a required sensor), clock_fit (NULL where a sensor's samples were placed by
// their receipt), slot (all frames that arrived in a record's slot, the number of the last one, how
// late the slot was closed), radar_array and antenna (radar_array.hpp; of a radar that
// sends its antennas' samples), speckle (speckle.hpp; over_carriers NULL with one carrier; its
// column over_150_ms came later still), late (of records whose slot samples came for after it
// was closed: tags and frames, in no record),
// signal (how strong each sensor's signal was, NULL where that is not known), counter (at each
// part's end: what the drivers counted, and samples that are in no record; its column part came
// later still), part (0 is the run as it was begun, then one a resume, from its first record on)
// and meta came later: older files of version 1 are without them until they are resumed. Times:
// *_ns are host monotonic nanoseconds, utc is ISO 8601.
#pragma once
#include <array>
#include <string>

#include "acquire/record/sqlite.hpp"

namespace echofuse::record {

inline constexpr int application_id = 0x4543464d;  // "ECFM"

inline constexpr const char* schema = R"(
CREATE TABLE IF NOT EXISTS run (uuid TEXT, started_utc TEXT, ended_utc TEXT, status TEXT, window_s REAL,
  config_text TEXT, config_resolved TEXT, radar_cfg TEXT, version TEXT, host TEXT, operator TEXT,
  notes TEXT);
CREATE TABLE IF NOT EXISTS device (sensor TEXT, address TEXT, model TEXT, serial TEXT, firmware TEXT);
CREATE TABLE IF NOT EXISTS calibration (sensor TEXT, date_utc TEXT, method TEXT, distance_m REAL, offset_m REAL,
  standard_error_m REAL);
CREATE TABLE IF NOT EXISTS axis (name TEXT PRIMARY KEY, quantity TEXT, unit TEXT, count INTEGER, start REAL,
  step REAL, scale REAL);
CREATE TABLE IF NOT EXISTS event (id INTEGER PRIMARY KEY, utc TEXT, level TEXT, source TEXT, text TEXT);
CREATE TABLE IF NOT EXISTS meta (key TEXT, value TEXT);
CREATE TABLE IF NOT EXISTS anchor (mono_ns INTEGER, utc_ns INTEGER);
CREATE TABLE IF NOT EXISTS radar_status (idx INTEGER PRIMARY KEY, inter_frame_processing_us INTEGER,
  transmit_us INTEGER, inter_frame_margin_us INTEGER, inter_chirp_margin_us INTEGER,
  active_frame_load_percent INTEGER, inter_frame_load_percent INTEGER, temperature_ms INTEGER,
  rx0_c INTEGER, rx1_c INTEGER, rx2_c INTEGER, rx3_c INTEGER, tx0_c INTEGER, tx1_c INTEGER,
  tx2_c INTEGER, pm_c INTEGER, dig0_c INTEGER, dig1_c INTEGER);
CREATE TABLE IF NOT EXISTS spd_status (idx INTEGER PRIMARY KEY, missed INTEGER, overflows INTEGER, errors INTEGER,
  bad_tags INTEGER, backwards INTEGER, removed INTEGER);
CREATE TABLE IF NOT EXISTS policy (sensor TEXT PRIMARY KEY, policy TEXT);
CREATE TABLE IF NOT EXISTS incomplete (idx INTEGER PRIMARY KEY, missing TEXT);
CREATE TABLE IF NOT EXISTS clock_fit (idx INTEGER PRIMARY KEY,
  spd_offset_s REAL, spd_drift_ppm REAL, spd_residual_s REAL, spd_samples INTEGER,
  radar_offset_s REAL, radar_drift_ppm REAL, radar_residual_s REAL, radar_samples INTEGER,
  depth_offset_s REAL, depth_drift_ppm REAL, depth_residual_s REAL, depth_samples INTEGER);
CREATE TABLE IF NOT EXISTS slot (idx INTEGER PRIMARY KEY, radar_frames INTEGER, radar_last INTEGER,
  depth_frames INTEGER, depth_last INTEGER, closed_late_s REAL);
CREATE TABLE IF NOT EXISTS signal (idx INTEGER PRIMARY KEY, clicks_a_pulse REAL, spd_clicks REAL,
  spd_peak_m REAL, radar_snr_db REAL, radar_peak_m REAL, depth_share REAL);
CREATE TABLE IF NOT EXISTS antenna (antenna INTEGER PRIMARY KEY, x REAL, y REAL, gain REAL, phase_rad REAL);
CREATE TABLE IF NOT EXISTS radar_array (idx INTEGER PRIMARY KEY, frames INTEGER, array BLOB);
CREATE TABLE IF NOT EXISTS speckle (idx INTEGER PRIMARY KEY, over_frames REAL, over_carriers REAL,
  over_150_ms REAL);
CREATE TABLE IF NOT EXISTS late (idx INTEGER PRIMARY KEY, spd INTEGER, radar INTEGER, depth INTEGER);
CREATE TABLE IF NOT EXISTS counter (source TEXT, name TEXT, value INTEGER, part INTEGER DEFAULT 0);
CREATE TABLE IF NOT EXISTS part (part INTEGER PRIMARY KEY, first_idx INTEGER, started_utc TEXT);
CREATE TABLE IF NOT EXISTS record (idx INTEGER PRIMARY KEY, slot_start_ns INTEGER, slot_end_ns INTEGER,
  slot_utc_ns INTEGER, valid INTEGER, label TEXT,
  tags INTEGER, starts INTEGER, in_range INTEGER, out_of_range INTEGER, without_start INTEGER,
  other INTEGER, tags_lost INTEGER,
  spd_offset_s REAL, spd_span_s REAL, spd_used INTEGER, spd_lost INTEGER, spd_verdict TEXT,
  radar_offset_s REAL, radar_span_s REAL, radar_used INTEGER, radar_lost INTEGER,
  radar_verdict TEXT,
  depth_offset_s REAL, depth_span_s REAL, depth_used INTEGER, depth_lost INTEGER,
  depth_verdict TEXT, spd BLOB, radar BLOB, depth BLOB);
)";

// What a table of an older file lacks.
inline void add_columns(sqlite3* db, const std::string& path) {
  struct Later {
    const char *table, *name, *type;
  };
  constexpr std::array<Later, 2> later{
      {{"counter", "part", "INTEGER DEFAULT 0"}, {"speckle", "over_150_ms", "REAL"}}};
  for (const Later& c : later) {
    if (has_column(db, path, c.table, c.name)) continue;
    const std::string sql =
        "ALTER TABLE " + std::string(c.table) + " ADD COLUMN " + c.name + " " + c.type;
    execute(db, path, sql.c_str(), "cannot add a column of this version");
  }
}

}  // namespace echofuse::record

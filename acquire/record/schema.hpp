// SPDX-License-Identifier: MIT
// The tables of a run file, version 1. A record's blobs stand last, so that its other columns are
// read without walking through them. Times: *_ns are host monotonic nanoseconds, utc is ISO 8601.
#pragma once

namespace echofuse::record {

inline constexpr int application_id = 0x4543464d;  // "ECFM"

inline constexpr const char* schema = R"(
CREATE TABLE run (uuid TEXT, started_utc TEXT, ended_utc TEXT, status TEXT, window_s REAL,
  config_text TEXT, config_resolved TEXT, radar_cfg TEXT, version TEXT, host TEXT, operator TEXT,
  notes TEXT);
CREATE TABLE device (sensor TEXT, address TEXT, model TEXT, serial TEXT, firmware TEXT);
CREATE TABLE calibration (sensor TEXT, date_utc TEXT, method TEXT, distance_m REAL, offset_m REAL,
  standard_error_m REAL);
CREATE TABLE axis (name TEXT PRIMARY KEY, quantity TEXT, unit TEXT, count INTEGER, start REAL,
  step REAL, scale REAL);
CREATE TABLE event (id INTEGER PRIMARY KEY, utc TEXT, level TEXT, source TEXT, text TEXT);
CREATE TABLE anchor (mono_ns INTEGER, utc_ns INTEGER);
CREATE TABLE record (idx INTEGER PRIMARY KEY, slot_start_ns INTEGER, slot_end_ns INTEGER,
  slot_utc_ns INTEGER, valid INTEGER, label TEXT,
  tags INTEGER, starts INTEGER, in_range INTEGER, out_of_range INTEGER, without_start INTEGER,
  other INTEGER, tags_lost INTEGER,
  spd_offset_s REAL, spd_span_s REAL, spd_used INTEGER, spd_lost INTEGER, spd_verdict TEXT,
  radar_offset_s REAL, radar_span_s REAL, radar_used INTEGER, radar_lost INTEGER,
  radar_verdict TEXT,
  depth_offset_s REAL, depth_span_s REAL, depth_used INTEGER, depth_lost INTEGER,
  depth_verdict TEXT, spd BLOB, radar BLOB, depth BLOB);
)";

}  // namespace echofuse::record

// SPDX-License-Identifier: MIT
// Messages of the WebSocket /live.
//
// Each message from the server is binary:
//   offset 0   length of the header in bytes, u32 little-endian
//   offset 4   header: a JSON object in UTF-8, followed by zeros up to the next multiple of 8
//   offset a   arrays, little-endian and row-major, each at a multiple of 8 bytes from a.
//              header["arrays"] describes them:
//              {NAME: {"type": "u8"|"u16"|"u32"|"f32"|"f64", "offset": from a, "shape": [...]}}
// header["kind"] is one of:
//   run        Constants of the run: file, uuid, window_s, axes, map (grid), model (name), trigger
//              (levels of the tagger), max_clicks_per_pulse (pile-up limit), baseline_m (distance
//              of the radar to the left of the detector, 0 if unknown), calibrated (true if the
//              model estimates its errors), facts (settings and devices as [name, text]),
//              may_write.
//   state      Sent every second and after each record: status, records, first_index, last_index,
//              elapsed_s, remaining_s, label, disk, events. sensors: {NAME: {verdict, valid, age_s
//              (since the end of its last valid slot), worst (most frequent doubtful verdict of the
//              run: word, valid, records; index and utc of the last doubtful record), used, arrived
//              (frames in its slot), lost, late, missing (number of records without its data),
//              residual_s}}. alerts: list of {source: sensor, disk or run, kind: "weak", "no data",
//              "low", "crashed"}. doubt: how the newest records differ from the training data of
//              the model, or null. doubts: summary of the verdicts of the whole run; doubtful:
//              number of doubtful records; last_doubt: index and utc of the last one. ended_utc:
//              empty for a live run.
//   record     index, utc, label, live, sensors, rates and fits (tally.hpp), spd (counts), radar
//              (dB), beams (dB by range and sine of azimuth, for radars with antenna samples),
//              camera (mm), map (camera depth on the grid of the maps, m), holes (fraction of
//              pixels without a return in camera and map). With a model also reconstruction (m) and
//              deviation (m) or the reason (fault), body position (x_m, z_m) and its interval, seen
//              (true for a training record), scores against the camera (iou, lateral_error_m), and
//              track: positions of the body in the last minute, newest first, [n, 4] of age (s), x,
//              z and 90 % interval of x (m), NaN if unknown.
//   sum        Sent after each record if requested: rates and fits (tally.hpp) of the last N
//              records, records (N), from (index of the first one). For more than one record also
//              spd (clicks) and radar (dB of the mean power). why: reason if the sum is missing.
//   reference  spd: mean histogram of the first minute.
//   strip      The whole run in at most strip_columns columns: first (index), time_s; for each
//              sensor used, lost, residual_s (worst in the column) and valid (fraction of records);
//              radar_c (highest temperature on the radar chip, degrees C) and margin_ms (shortest
//              idle time of a radar frame).
//   sheet      Thumbnails of records at equal distances in the run: index, maps (m) of sheet_side x
//              sheet_side pixels, lacks (true if the depth map is missing), time_s since the first
//              record. Columns of a waterfall: spd (clicks), radar (dB), NaN if missing.
//   saved      First message of a saved page: utc, records (indices of its records, which are the
//              following messages), of (number of records of the run).
//   answer     Result of a mark or label: ok, text.
//   trouble    Sent every second instead of state if the run cannot be shown: text (reason).
// Each message from the client is a text of at most 1024 bytes, e.g.
//   {"show": "live"}  {"show": 17}  {"sheet": [0, 500]}  {"mark": "door opened"}  {"label": "two"}
//   {"sum": [100, 2.5, 4]}: sums 100 records (0: all since the newest mark), fits from 2.5 to 4 m
// If a client sends requests faster than they are answered, only the newest of each kind is
// answered; all marks and labels are answered.
#pragma once
#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "recon/live/tally.hpp"

namespace echofuse::view {

inline constexpr std::size_t max_request_bytes = 1024, max_text_bytes = 200;
inline constexpr std::size_t strip_columns = 360, sheet_maps = 48, sheet_side = 32,
                             max_summed = 1000;

using Message = std::shared_ptr<const Bytes>;

// Returns the value as a JSON number, or null if it is not finite.
nlohmann::json number(double value);

class MessageWriter {
 public:
  template <class T>
  void add(const std::string& name, std::span<const T> values, std::vector<std::size_t> shape);
  template <class T>
  void add(const std::string& name, const std::vector<T>& values) {
    add<T>(name, values, {values.size()});
  }
  Message finish(nlohmann::json header) const;

 private:
  struct Array {
    std::string name;
    std::string type;
    std::size_t offset;
    std::vector<std::size_t> shape;
  };
  std::vector<Array> arrays_;
  Bytes bytes_;
};

struct ShowLive {};
struct ShowRecord {
  std::int64_t index = 0;
};
struct ShowSheet {
  std::int64_t first = 0, last = 0;
};
struct ShowSum {
  std::int64_t records = 1;  // number of records to sum; 0: all records since the newest mark
  FitRange range;
};
struct Mark {
  bool label = false;
  std::string text;
};
struct BadRequest {
  std::string why;
};
using Request = std::variant<ShowLive, ShowRecord, ShowSheet, ShowSum, Mark, BadRequest>;

// Parses a request from a client. Accepts any string; returns BadRequest if the string is not a
// valid request.
Request parse_request(std::string_view text);

}  // namespace echofuse::view

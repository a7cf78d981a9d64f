// SPDX-License-Identifier: MIT
// Messages of the WebSocket /live.
//
// Each message from the server is binary:
//   offset 0   u32 LE n, length of the header
//   offset 4   header: a JSON object, UTF-8; then zeros up to the next multiple of 8
//   offset a   arrays, each at a multiple of 8 from a; header["arrays"] describes them:
//              {NAME: {"type": "u8"|"u16"|"u32"|"f32"|"f64", "offset": from a, "shape": [...]}},
//              little-endian, row-major
// header["kind"] is one of
//   run        constants of the run: file, uuid, window_s, axes, grid of the maps, creator,
//              model name, trigger (levels of the tagger), most_clicks_a_pulse (limit of pile-up),
//              baseline_m (radar to the left of the detector, 0 if unknown), whether the model
//              estimates its uncertainty (calibrated), facts (settings, devices: [name, text]
//              each), may_write
//   state      every second and with each record: status, records, first_index, last_index,
//              elapsed_s, remaining_s, label, disk, events, and sensors: {NAME: {verdict, valid,
//              age_s (since the end of its last valid slot), used, arrived (frames in its slot),
//              lost, late, missing (records without it), residual_s}}; alerts: {source:
//              sensor, disk or run, kind: "weak", "no data", "low", "crashed"} each; with a model
//              doubt: reason why the newest maps are unreliable as a group, or null; doubts:
//              summary of the verdicts of the whole run
//   record     index, utc, label, live, sensors, rates and fits (tally.hpp), and spd (counts),
//              radar (dB), beams (dB by range and sine of azimuth, for radars with antennas),
//              camera (mm), map (m, the camera's depth on the grid of the maps); with a model
//              reconstruction (m) and deviation (m), or the reason why it is missing; body
//              position (x_m, z_m), reliability, whether this record was in the training data
//              (seen), errors against the camera (iou, lateral_error_m);
//              track: positions of the body in the minute before, newest first: [n, 4] of age (s),
//              x, z, 90 % interval of x (m), NaN if unknown; holes: share of pixels without a
//              return in camera and map
//   sum        after each record, if requested: rates and fits (tally.hpp) of the last `records`
//              records, `from` (index of the first), and for more than one record spd (clicks) and
//              radar (dB of the mean power); or `why` it is missing
//   reference  spd: mean histogram of the first minute
//   strip      the whole run in at most strip_columns columns: first (index), time_s; for each
//              sensor used, lost, residual_s and the share of valid records; radar_c (highest
//              temperature on the radar chip, degrees C) and margin_ms (spare time of its frames):
//              worst of the column
//   sheet      thumbnails of records spread over the run: index, maps (m) of sheet_side pixels,
//              which of them lack a depth map (lacks); time_s since the first record; and columns
//              of a waterfall: spd (clicks), radar (dB), NaN if missing
//   answer     result of a mark or label: ok, text
//   trouble    every second instead of state if the run cannot be shown: text (reason)
// From the client: text of at most 1024 bytes, one of
//   {"show": "live"}  {"show": 17}  {"sheet": [0, 500]}  {"mark": "door opened"}  {"label": "two"}
//   {"sum": [100, 2.5, 4]}: 100 records, or since the newest mark (0); fits between 2.5 and 4 m
// If a client sends requests faster than they are answered, only the newest is answered.
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

inline constexpr std::size_t most_request_bytes = 1024, most_text_bytes = 200;
inline constexpr std::size_t strip_columns = 360, sheet_maps = 48, sheet_side = 32,
                             most_summed = 1000;

using Message = std::shared_ptr<const Bytes>;

// Returns null if the value is not finite.
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
    const char* type;
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
  std::int64_t records = 1;  // 0: since the newest mark
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

// Accepts any input.
Request parse_request(std::string_view text);

}  // namespace echofuse::view

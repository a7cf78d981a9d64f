// SPDX-License-Identifier: MIT
// Messages of the WebSocket /live.
//
// From the server, one binary message each:
//   off 0   u32 LE n, the length of the header
//   off 4   header: a JSON object, UTF-8; then zeros up to the next multiple of 8
//   off a   the arrays, each at a multiple of 8 from a; header["arrays"] names them:
//           {NAME: {"type": "u8"|"u16"|"u32"|"f32"|"f64", "offset": from a, "shape": [...]}},
//           little-endian, row-major
// header["kind"] is one of
//   run        what does not change: file, uuid, window_s, axes, the grid of the maps, who made it,
//              the model's name, whether it states its uncertainty (calibrated), facts
//              (settings, devices: [name, text] each), may_write
//   state      every second, and with each record: status, records, first_index, last_index,
//              elapsed_s, remaining_s, label, disk, events, and sensors: {NAME: {verdict, valid,
//              age_s (since the end of its last valid slot), used, arrived (frames of its slot),
//              lost, late, missing (records without it), residual_s}}; with a model doubt: why the
//              newest maps as a whole are not to be trusted, or null; doubts: the verdict over the
//              whole run
//   record     index, utc, label, live, sensors, and spd (counts), radar (dB), beams (dB by range
//              and sine of the azimuth, of a radar with antennas), camera (mm), map (m,
//              what the camera sees on the grid of the maps); with a model reconstruction (m) and
//              deviation (m), or the reason why there is none, where the body is (x_m, z_m), how
//              far to trust it, whether the model was trained on this record (seen), and
//              how well it meets what the camera sees (iou, lateral_error_m)
//   reference  spd: mean histogram of the first minute
//   strip      the whole run in at most strip_columns columns: first (index), time_s; used,
//              lost, residual_s of each sensor, and the share of its records that are valid
//   sheet      small maps of records spread over the run: index, maps (m) of sheet_side pixels, and
//              which of them lack a depth picture (lacks); time_s of each since the first record,
//              and columns of a waterfall: spd (clicks), radar (dB), NaN without
//   answer     what became of a mark or a label: ok, text
//   trouble    why there is nothing to see: text
// From the client, text, at most 1024 bytes: one of
//   {"show": "live"}  {"show": 17}  {"sheet": [0, 500]}  {"mark": "door opened"}  {"label": "two"}
// A client that asks quickly gets the answer to its last question only.
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

namespace echofuse::view {

inline constexpr std::size_t most_request_bytes = 1024, most_text_bytes = 200;
inline constexpr std::size_t strip_columns = 360, sheet_maps = 48, sheet_side = 32;

using Message = std::shared_ptr<const Bytes>;

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
struct Mark {
  bool label = false;
  std::string text;
};
struct BadRequest {
  std::string why;
};
using Request = std::variant<ShowLive, ShowRecord, ShowSheet, Mark, BadRequest>;

// Takes anything.
Request parse_request(std::string_view text);

}  // namespace echofuse::view

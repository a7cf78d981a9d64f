// SPDX-License-Identifier: MIT
#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "acquire/import/import.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "acquire/measurement/response.hpp"
#include "acquire/record/run_file.hpp"
#include "acquire/run/resume.hpp"
#include "drivers/program/console.hpp"
#include "drivers/program/new_file.hpp"
#include "drivers/program/npy.hpp"
#include "drivers/program/printable.hpp"
#include "drivers/program/program.hpp"
#include "drivers/program/settings.hpp"

namespace echofuse::acquire {
namespace {

namespace fs = std::filesystem;

constexpr std::uint32_t most_points = 1u << 24;  // bins of a record's histogram or profile

struct Description {
  double window_s = 3, first_bin_ps = 0, bin_width_ps = 100, first_m = 0, step_m = 0.25,
         half_tangent = 0.55, far_m = record::MapGrid{}.far_m, irf_fwhm_ps = 0, radar_cell_m = 0;
  std::string label, notes, depth_unit, radar_taps;
  std::int64_t map_size = 0;
  std::vector<std::string> labels;
};

void bind(Settings& settings, Description& d) {
  settings.add("window_s", d.window_s, 1e-6, 1e6, "length of a slot");
  settings.add("label", d.label, "of every record");
  settings.add("labels", d.labels, "one a record; instead of label");
  settings.add("notes", d.notes, "where the arrays come from");
  settings.add("spd.first_bin_ps", d.first_bin_ps, -1e9, 1e9, "start of bin 0, two-way time");
  settings.add("spd.bin_width_ps", d.bin_width_ps, 1e-3, 1e9, "width of a bin, two-way time");
  settings.add("spd.irf_fwhm_ps", d.irf_fwhm_ps, 0, 1e6, "impulse response; 0: not stated");
  settings.add("radar.first_m", d.first_m, -1e4, 1e4, "range of point 0");
  settings.add("radar.step_m", d.step_m, 1e-6, 1e4, "from point to point");
  settings.add("radar.cell_m", d.radar_cell_m, 0, 1e3, "c / 2B; 0: response not stated");
  settings.add("radar.taps", d.radar_taps, "power at 0, 1/4, 2/4 ... of a cell, over its peak");
  settings.add("depth.unit", d.depth_unit, "default: mm of whole numbers, m of others",
               {"", "mm", "m"});
  settings.add("depth.half_tangent", d.half_tangent, record::least_map_half_tangent,
               record::most_map_half_tangent, "x/z at the left and right edge");
  settings.add("depth.map_z_max_m", d.far_m, record::least_map_far_m, record::most_map_far_m,
               "what lies beyond is no return");
  settings.add("depth.map_size", d.map_size, 0, record::most_map_size,
               "pixels of the maps both ways; 0: as the images, or 64");
}

// Arrays of a folder, row by row.
class Arrays {
 public:
  Arrays(const std::string& folder, const Description& d) : d_(d) {
    const auto open = [&](const char* name, std::size_t dimensions) -> std::unique_ptr<NpyFile> {
      const std::string path = (fs::path(folder) / name).string();
      if (!fs::exists(path)) return nullptr;
      auto file = std::make_unique<NpyFile>(path);
      if (file->shape().size() != dimensions || file->row_size() == 0)
        throw Error(ExitCode::failed, printable(path) + ": its shape is " + file->shape_text() +
                                          "; expected " + std::to_string(dimensions) +
                                          " dimensions, a row for each record");
      if (!first_) first_ = path, rows_ = file->rows();
      if (file->rows() != rows_)
        throw Error(ExitCode::failed, printable(path) + ": has " + std::to_string(file->rows()) +
                                          " rows; " + printable(*first_) + " has " +
                                          std::to_string(rows_));
      return file;
    };
    spd_ = open("spd.npy", 2), radar_ = open("radar.npy", 2), depth_ = open("depth.npy", 3);
    if (!spd_ && !radar_)
      throw Error(ExitCode::failed,
                  printable(folder) + ": has neither spd.npy [n, bins] nor radar.npy [n, points]");
    if (!d_.labels.empty() && d_.labels.size() != rows_)
      throw Error(ExitCode::config, printable(folder) +
                                        "/run.toml: " + std::to_string(d_.labels.size()) +
                                        " labels for " + std::to_string(rows_) + " records");
    if (d_.map_size > 0 && d_.map_size < record::least_map_size)
      throw Error(ExitCode::config, printable(folder) + "/run.toml: depth.map_size = " +
                                        std::to_string(d_.map_size) + "; expected 0 or 16 to 256");
    if (depth_) millimetres_ = d_.depth_unit.empty() ? depth_->is_integer() : d_.depth_unit == "mm";
  }

  std::size_t rows() const { return rows_; }

  std::vector<Axis> axes() const {
    std::vector<Axis> out;
    const auto count = [](const NpyFile& f, std::size_t k) {
      return static_cast<std::uint32_t>(f.shape()[k]);
    };
    if (spd_)
      out.push_back({"spd", "counts", "ps", count(*spd_, 1), d_.first_bin_ps, d_.bin_width_ps, 1});
    if (radar_) out.push_back({"radar", "power", "m", count(*radar_, 1), d_.first_m, d_.step_m, 1});
    for (const Axis& axis : out)
      if (axis.count > most_points)
        throw Error(ExitCode::failed, printable(*first_) + ": has " + std::to_string(axis.count) +
                                          " values a record; expected at most " +
                                          std::to_string(most_points));
    if (!depth_) return out;
    const auto height = count(*depth_, 1), width = count(*depth_, 2);
    const double up = d_.half_tangent * height / width;
    out.push_back(record::depth_x_axis(width, d_.half_tangent));
    out.push_back(record::depth_y_axis(height, up));
    const bool fits =
        height == width && width >= record::least_map_size && width <= record::most_map_size;
    record::MapGrid grid;
    grid.half_tangent = d_.half_tangent, grid.far_m = d_.far_m;
    if (d_.map_size > 0 || fits)
      grid.size = d_.map_size > 0 ? static_cast<std::uint32_t>(d_.map_size) : width;
    for (const Axis& axis : grid.axes()) out.push_back(axis);
    return out;
  }

  record::FusedRecord next(std::size_t row) {
    record::FusedRecord r;
    r.index = static_cast<std::int64_t>(row);
    r.slot_start = from_seconds(d_.window_s * static_cast<double>(row));
    r.slot_end = from_seconds(d_.window_s * static_cast<double>(row + 1));
    r.label = d_.labels.empty() ? d_.label : d_.labels[row];
    if (spd_) put_counts(r, read(*spd_, row, 0, "counts from 0 on"));
    if (radar_) put_power(r, read(*radar_, row, -1e30, "finite power"));
    if (depth_) put_depth(r, depth_->next_row());
    return r;
  }

 private:
  // A row of numbers from `least` on, or nothing of a row of NaN. Noise makes power negative.
  std::vector<double> read(NpyFile& file, std::size_t row, double least, const char* what) const {
    std::vector<double> values = file.next_row();
    if (std::ranges::all_of(values, [](double v) { return std::isnan(v); })) return {};
    const auto bad =
        std::ranges::find_if(values, [&](double v) { return !(v >= least && v < 1e30); });
    if (bad == values.end()) return values;
    throw Error(ExitCode::failed, printable(file.path()) + ": row " + std::to_string(row) +
                                      " has " + std::to_string(*bad) + "; expected " + what +
                                      ", or a whole row of NaN for a missing sensor");
  }

  void mark(record::FusedRecord& r, Sensor sensor, std::uint64_t used) const {
    r.valid.insert(sensor);
    r.sync[sensor] = {0, d_.window_s, used, 0, "ok"};
  }

  void put_counts(record::FusedRecord& r, const std::vector<double>& values) {
    if (values.empty()) return;
    for (const double v : values) {
      if (v > std::numeric_limits<std::uint32_t>::max())
        throw Error(ExitCode::failed, printable(spd_->path()) + ": row " + std::to_string(r.index) +
                                          " has a count of more than 32 bits");
      r.spd.push_back(static_cast<std::uint32_t>(std::lround(v)));
      r.spd_counts.in_range += r.spd.back();
    }
    if (r.spd_counts.in_range == 0 && std::ranges::any_of(values, [](double v) { return v > 0; }))
      throw Error(ExitCode::failed, printable(spd_->path()) + ": row " + std::to_string(r.index) +
                                        " has no count above a half; expected photons a bin: "
                                        "multiply a normalised histogram by its photons");
    r.spd_counts.tags = r.spd_counts.in_range;
    mark(r, Sensor::spd, r.spd_counts.in_range);
  }

  void put_power(record::FusedRecord& r, const std::vector<double>& values) {
    if (values.empty()) return;
    r.radar.assign(values.begin(), values.end());
    mark(r, Sensor::radar, 1);
  }

  void put_depth(record::FusedRecord& r, const std::vector<double>& values) {
    if (std::ranges::all_of(values, [](double v) { return std::isnan(v); })) return;
    std::vector<double> returns;
    for (const double v : values) {
      const double mm = std::isnan(v) ? 0 : v * (millimetres_ ? 1 : 1000);
      if (!(mm >= 0 && mm <= std::numeric_limits<std::uint16_t>::max()))
        throw Error(ExitCode::failed, printable(depth_->path()) + ": row " +
                                          std::to_string(r.index) + " has a depth of " +
                                          std::to_string(mm / 1000) + " m; expected 0 to 65.5 m" +
                                          (millimetres_ ? "" : ", or depth.unit = \"mm\""));
      r.depth_mm.push_back(static_cast<std::uint16_t>(std::lround(mm)));
      if (r.depth_mm.back() > 0) returns.push_back(mm);
    }
    if (!returns.empty()) {
      const auto middle = returns.begin() + static_cast<std::ptrdiff_t>(returns.size() / 2);
      std::nth_element(returns.begin(), middle, returns.end());
      if (*middle < 20)
        throw Error(ExitCode::failed,
                    printable(depth_->path()) + ": row " + std::to_string(r.index) +
                        ": its median is " + std::to_string(std::lround(*middle)) +
                        " mm; expected " +
                        (millimetres_ ? "millimetres (of metres: depth.unit = \"m\")" : "metres"));
    }
    mark(r, Sensor::depth, 1);
  }

  Description d_;
  std::unique_ptr<NpyFile> spd_, radar_, depth_;
  std::optional<std::string> first_;
  std::size_t rows_ = 0;
  bool millimetres_ = true;
};

// Reads back as the same number.
std::string shortest_text(double value) {
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

std::vector<std::pair<std::string, std::string>> stated(const Description& d) {
  std::vector<std::pair<std::string, std::string>> given;
  if (d.irf_fwhm_ps > 0)
    given = {{"irf_fwhm_ps", shortest_text(d.irf_fwhm_ps)}, {"irf_tail_ps", "0"}};
  if (d.radar_cell_m > 0 && !d.radar_taps.empty()) {
    given.emplace_back("radar_cell_m", shortest_text(d.radar_cell_m));
    given.emplace_back("radar_taps", d.radar_taps);
  }
  auto known = record::response_of(given).meta();
  for (auto& [key, text] : known)
    for (const auto& [name, as_given] : given)
      if (name == key) text = as_given;
  return known;
}

}  // namespace

std::string import_arrays(const std::string& folder, const std::string& out, UtcTime began) {
  refuse_bad_target(out);
  refuse_late_clock(began);
  const std::string path = (fs::path(folder) / "run.toml").string();
  record::RunInfo info;
  info.config_text = read_config_text(path);
  Description d;
  Settings settings;
  bind(settings, d);
  settings.read_text(info.config_text, path);
  Arrays arrays(folder, d);
  info.config_resolved = settings.resolved();
  info.version = version();
  info.host = machine_name();
  info.operator_name = login_name();
  info.notes = d.notes;
  info.window_s = d.window_s;
  info.meta = stated(d);

  NewFile file(out, NewFile::Staged{});
  record::RunWriter writer(file.path(), info);
  for (const Axis& axis : arrays.axes()) writer.put_axis(axis);
  PerSensor<std::int64_t> valid{};
  std::vector<record::FusedRecord> batch;
  Progress progress("import", arrays.rows(), false);
  for (std::size_t row = 0; row < arrays.rows(); ++row) {
    if (interrupted()) throw Error(ExitCode::interrupted, "interrupted; nothing was written");
    batch.push_back(arrays.next(row));
    batch.back().slot_utc = began + batch.back().slot_start;
    for (const Sensor s : all_sensors) valid[s] += batch.back().has(s);
    if (batch.size() < 64 && row + 1 < arrays.rows()) continue;
    writer.append(batch);
    batch.clear();
    progress.update(row + 1);
  }
  writer.close_as_one_file("complete");
  file.publish();
  std::string counts;
  for (const Sensor s : all_sensors)
    if (valid[s] > 0) counts += std::string(", ") + name_of(s) + " in " + std::to_string(valid[s]);
  return printable(file.place()) + ": " + std::to_string(arrays.rows()) + " records" + counts;
}

}  // namespace echofuse::acquire

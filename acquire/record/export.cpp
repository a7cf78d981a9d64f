// SPDX-License-Identifier: MIT
#include "acquire/record/export.hpp"

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <utility>

#include "acquire/record/h5_out.hpp"
#include "acquire/record/run_parts.hpp"
#include "drivers/core/log2_codes.hpp"
#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"
#include "drivers/program/staged_file.hpp"

namespace echofuse::record {
namespace {

const std::string data = "/entry/data/";

std::vector<double> points(const Axis& axis) {
  std::vector<double> all;
  for (std::uint32_t i = 0; i < axis.count; ++i) all.push_back(axis.at(i));
  return all;
}

void write_axis(H5Out& out, const std::string& name, const Axis& axis) {
  out.write(data + name, points(axis), {axis.count});
  out.set(data + name, "units", axis.unit);
  out.set(data + name, "quantity", axis.quantity);
  out.set(data + name, "scale", axis.scale);
}

void write_head(H5Out& out, const RunReader& run, const std::string& started) {
  const RunInfo info = run.info();
  out.make_group("/entry");
  out.set("/", "default", "entry");
  out.set("/entry", "NX_class", "NXentry");
  out.set("/entry", "default", "data");
  const std::pair<const char*, std::string> texts[] = {{"title", info.notes},
                                                       {"entry_identifier", info.uuid},
                                                       {"start_time", started},
                                                       {"end_time", info.ended_utc},
                                                       {"status", info.status},
                                                       {"program_name", "echofuse " + info.version},
                                                       {"operator", info.operator_name},
                                                       {"configuration", info.config_resolved},
                                                       {"radar_cfg", info.radar_cfg}};
  for (const auto& [name, text] : texts) out.write_text(std::string("/entry/") + name, text);
  // Values and axes are as they were measured: true range = range - offset_m.
  for (const auto& c : run.calibrations()) {
    const std::string group = std::string("/entry/calibration_") + name_of(c.sensor);
    if (!out.has(group)) out.make_group(group);
    out.set(group, "offset_m", c.offset_m);
    out.set(group, "standard_error_m", c.standard_error_m);
    out.set(group, "distance_m", c.distance_m);
    out.set(group, "date_utc", c.date_utc);
    out.set(group, "method", c.method);
  }
  for (const auto& device : run.devices()) {
    const std::string group = std::string("/entry/instrument/") + name_of(device.sensor);
    if (out.has(group)) continue;  // reconnected
    out.make_group(group);
    out.set(group, "NX_class", "NXdetector");
    out.write_text(group + "/address", device.address);
    out.write_text(group + "/model", device.model);
    out.write_text(group + "/serial", device.serial);
    out.write_text(group + "/firmware", device.firmware);
  }
}

// As xarray and netCDF read an epoch.
constexpr auto since_1970 = "nanoseconds since 1970-01-01T00:00:00Z";
constexpr auto of_the_machine = "nanoseconds since the start of the machine (CLOCK_MONOTONIC)";

// By the end of a column's name; "1" is a count, a flag or a ratio.
std::string units_of(const std::string& table, const std::string& column) {
  if (column.starts_with("speckle")) return "1";  // over_150_ms as well
  if (table == "antenna" && (column == "x" || column == "y")) return "half wavelengths";
  if (table == "axis" && (column == "start" || column == "step")) return "as the row's unit says";
  if (column.ends_with("utc_ns")) return since_1970;
  if (column == "mono_ns" || (table == "record" && column.ends_with("_ns"))) return of_the_machine;
  constexpr std::pair<const char*, const char*> units[] = {
      {"_db", "dB"}, {"_ns", "ns"},   {"_us", "us"},    {"_ms", "ms"},     {"_s", "s"},
      {"_m", "m"},   {"_rad", "rad"}, {"_ppm", "1e-6"}, {"_percent", "%"}, {"_c", "degC"}};
  for (const auto& [end, unit] : units)
    if (column.ends_with(end)) return unit;
  return "1";
}

// All of the run but the sensors' data, as its tables have it.
void write_tables(H5Out& out, const std::vector<std::string>& files) {
  for (const auto& [table, columns] : joined_tables(files)) {
    const std::string group = "/entry/tables/" + table;
    out.make_group(group);
    for (const Column& column : columns) {
      const std::string name = group + "/" + column.name;
      if (const auto* texts = std::get_if<std::vector<std::string>>(&column.values)) {
        out.write_texts(name, *texts);
        continue;
      }
      if (const auto* whole = std::get_if<std::vector<std::int64_t>>(&column.values)) {
        out.write(name, *whole, {whole->size()});
        out.set(name, "missing_value", null_integer);
      } else {
        const auto& real = std::get<std::vector<double>>(column.values);
        out.write(name, real, {real.size()});
      }
      out.set(name, "units", units_of(table, column.name));
    }
  }
}

// What the values of the radar axis are (drivers/core/axis.hpp).
std::string meaning_of(const Axis& radar) {
  if (radar.quantity == "log2_q8")
    return "256 * log2(magnitude), summed over the axis's `scale` virtual antennas and divided by "
           "the next power of two";
  if (radar.quantity == "binned_power")
    return "linear power on an arbitrary scale, added up over a step around each point";
  return "linear power on an arbitrary scale";
}

// The arrays of one sensor each, made for n records.
class Arrays {
 public:
  Arrays(H5Out& out, const RunReader& run, std::size_t n) : out_(out) {
    out.make_group("/entry/data");
    out.set("/entry/data", "NX_class", "NXdata");
    out.set("/entry/data", "signal", "spd");
    if (const auto spd = run.axis("spd"); spd && spd->count > 0) {
      out.allocate<std::uint32_t>(data + "spd", {n, spd->count});
      out.set(data + "spd", "units", "counts");
      out.set(data + "spd", "long_name", "detections per bin of two-way time of flight");
      write_axis(out, "spd_time", *spd);
    }
    if (const auto radar = run.axis("radar"); radar && radar->count > 0) {
      out.allocate<float>(data + "radar", {n, radar->count});
      const bool codes = radar->quantity == "log2_q8";
      out.set(data + "radar", "units", codes ? "log2_q8" : "1");
      out.set(data + "radar", "long_name", meaning_of(*radar));
      write_axis(out, "radar_range", *radar);
      if (codes) {
        codes_of_antennas_ = radar->scale;
        out.allocate<float>(data + "radar_power", {n, radar->count});
        out.set(data + "radar_power", "units", "1");
        out.set(data + "radar_power", "long_name", "linear power on an arbitrary scale");
      }
    }
    if (const auto array = run.axis("array"); array && array->count > 0) {
      const std::size_t values = values_of_bin(antennas_of(*array));
      out.allocate<float>(data + "array", {n, array->count, values});
      out.set(data + "array", "units", "the firmware's integers, squared where it is a power");
      out.set(data + "array", "long_name",
              "of each range bin, over a record's frames: mean sample of each antenna (real, "
              "imaginary); power of each; mean of x_m conj(x_n) for m < n, row by row; mean of "
              "sum_m x_m(t) conj(x_m(t-1)); antennas as /entry/tables/antenna");
      write_axis(out, "array_range", *array);
    }
    const auto x = run.axis("depth_x"), y = run.axis("depth_y");
    if (x && y && x->count > 0 && y->count > 0) {
      out.allocate<float>(data + "depth", {n, y->count, x->count});
      out.set(data + "depth", "units", "mm");
      out.set(data + "depth", "long_name", "z of each pixel, NaN: no return");
      write_axis(out, "depth_x", *x);
      write_axis(out, "depth_y", *y);
    }
  }
  void write(std::size_t row, const FusedRecord& r) {
    if (r.has(Sensor::spd)) out_.write_row<std::uint32_t>(data + "spd", row, r.spd);
    if (r.has(Sensor::radar)) out_.write_row<float>(data + "radar", row, r.radar);
    if (!r.array.empty()) out_.write_row<float>(data + "array", row, r.array);
    if (r.has(Sensor::depth)) {
      std::vector<float> depth(r.depth_mm.begin(), r.depth_mm.end());
      std::ranges::replace(depth, 0.F, std::numeric_limits<float>::quiet_NaN());
      out_.write_row<float>(data + "depth", row, depth);
    }
    if (r.has(Sensor::radar) && codes_of_antennas_ > 0) {
      std::vector<float> power = r.radar;
      for (float& v : power) v = static_cast<float>(power_from_code(double{v}, codes_of_antennas_));
      out_.write_row<float>(data + "radar_power", row, power);
    }
  }
  // What stands along each dimension, as dimension scales and, of one signal a group, as NXdata.
  void name_dimensions() {
    const std::pair<const char*, std::vector<std::string>> signals[] = {
        {"spd", {"index", "spd_time"}},
        {"radar", {"index", "radar_range"}},
        {"radar_power", {"index", "radar_range"}},
        {"array", {"index", "array_range"}},
        {"depth", {"index", "depth_y", "depth_x"}}};
    for (const auto& [signal, axes] : signals) {
      if (!out_.has(data + signal)) continue;
      for (unsigned d = 0; d < axes.size(); ++d) out_.put_scale(data + signal, d, data + axes[d]);
      const std::string group = std::string("/entry/") + signal;
      out_.make_group(group);
      for (const auto& name : axes) out_.link(group + "/" + name, data + name);
      out_.link(group + "/" + signal, data + signal);
      std::vector<std::string> along = axes;
      if (signal == std::string("array")) along.push_back(".");
      out_.set(group, "NX_class", "NXdata");
      out_.set(group, "signal", signal);
      out_.set(group, "axes", along);
    }
    if (out_.has(data + "spd")) out_.set("/entry/data", "axes", signals[0].second);
  }

 private:
  H5Out& out_;
  double codes_of_antennas_ = 0;  // 0: the radar gives powers
};

// Everything of a record but the sensors' data, gathered in memory.
class Columns {
 public:
  void add(const FusedRecord& r) {
    valid_.push_back(static_cast<std::uint8_t>(r.valid.bits()));
    index_.push_back(r.index);
    start_.push_back(r.slot_start.count());
    end_.push_back(r.slot_end.count());
    utc_.push_back(r.slot_utc.count());
    label_.push_back(r.label);
    array_frames_.push_back(r.array_frames);
    for (const Sensor s : all_sensors) {
      sync_[s].offset.push_back(r.sync[s].offset_s);
      sync_[s].span.push_back(r.sync[s].span_s);
      sync_[s].used.push_back(r.sync[s].used);
      sync_[s].lost.push_back(r.sync[s].lost);
      sync_[s].verdict.push_back(r.sync[s].verdict);
    }
  }
  void write(H5Out& out) const {
    put(out, data + "valid", valid_, "1");
    put(out, data + "index", index_, "1");
    put(out, data + "slot_start", start_, of_the_machine);
    put(out, data + "slot_end", end_, of_the_machine);
    put(out, data + "slot_utc", utc_, since_1970);
    out.write_texts(data + "label", label_);
    if (out.has(data + "array")) put(out, data + "array_frames", array_frames_, "1");
    for (const Sensor s : all_sensors) {
      const Sync& sync = sync_[s];
      const std::string group = std::string("/entry/sync/") + name_of(s) + "/";
      put(out, group + "offset", sync.offset, "s");
      put(out, group + "span", sync.span, "s");
      put(out, group + "used", sync.used, "1");
      put(out, group + "lost", sync.lost, "1");
      out.write_texts(group + "verdict", sync.verdict);
    }
  }

 private:
  struct Sync {
    std::vector<double> offset, span;
    std::vector<std::uint64_t> used, lost;
    std::vector<std::string> verdict;
  };
  template <class T>
  static void put(H5Out& out, const std::string& name, const std::vector<T>& values,
                  const std::string& units) {
    out.write(name, values, {values.size()});
    out.set(name, "units", units);
  }

  std::vector<std::uint8_t> valid_;
  std::vector<std::int64_t> index_, start_, end_, utc_;
  std::vector<std::string> label_;
  std::vector<std::uint64_t> array_frames_;
  PerSensor<Sync> sync_;
};

std::int64_t write_h5(H5Out& out, const std::vector<std::string>& files,
                      const std::function<void(std::int64_t, std::int64_t)>& progress) {
  std::int64_t total = 0;  // a live run may grow meanwhile
  for (const std::string& file : files) total += RunReader(file).count();
  std::int64_t done = 0, bad = 0;
  const RunReader run(files.back());
  write_head(out, run, RunReader(files.front()).info().started_utc);
  Arrays arrays(out, run, static_cast<std::size_t>(total));
  Columns columns;
  const auto add = [&](const FusedRecord& r) {
    if (done == total) return false;
    arrays.write(static_cast<std::size_t>(done), r);
    columns.add(r);
    ++done;
    if (progress) progress(done, total);
    return done < total;
  };
  for (const std::string& file : files)
    RunReader(file).for_each(add, std::numeric_limits<std::int64_t>::min(),
                             [&](std::int64_t index, const std::string& fault) {
                               FusedRecord r;
                               r.index = index;
                               for (auto& sync : r.sync) sync.verdict = "unreadable: " + fault;
                               bad += done < total;
                               add(r);
                             });
  columns.write(out);
  arrays.name_dimensions();
  write_tables(out, files);
  out.close();
  return bad;
}

void refuse_existing(const std::string& path) {
  if (::access(path.c_str(), F_OK) == 0)
    throw Error(ExitCode::failed, path + ": exists already; choose another name");
}

}  // namespace

std::int64_t export_h5(const std::vector<std::string>& files, const std::string& path,
                       const std::function<void(std::int64_t, std::int64_t)>& progress) {
  refuse_existing(path);
  StagedFile staged(path);
  H5Out out(staged.path());
  const std::int64_t bad = write_h5(out, files, progress);
  staged.publish();
  return bad;
}

namespace {

// In a line that is no cell: nothing begins another one, whatever the separator.
std::string in_comment(const std::string& text) {
  std::string out;
  for (const char c : printable(text, 200))
    if (c == ',' || c == ';' || c == '"')
      out += c == ',' ? "\\x2c" : c == ';' ? "\\x3b" : "\\x22";
    else
      out += c;
  return out;
}

}  // namespace

void export_csv(const RunReader& run, std::int64_t index, const std::string& path) {
  const FusedRecord r = run.read(index);
  refuse_existing(path);
  StagedFile staged(path);
  std::ofstream out(staged.path());
  out.precision(std::numeric_limits<float>::max_digits10);
  out << "# record " << r.index << " of " << in_comment(run.path()) << ", label "
      << in_comment(r.label)
      << "\n# spd: x = two-way time in ps, value = counts\n"
         "# radar: x = range in m, value = as in the run's radar axis\n"
         "# depth: x, y = tangents, value = mm, 0 = no return\n";
  const auto antennas = run.antennas();
  const bool has_array = !r.array.empty() && !antennas.empty();
  if (has_array)
    out << "# array: x = range in m, y = sine of the azimuth (right: above 0), value = power that "
           "comes from there, mean over "
        << r.array_frames << " frames\n";
  out << "sensor,x,y,value\n";
  const auto put_profile = [&](Sensor s, const auto& values) {
    const auto axis = run.axis(name_of(s));
    for (std::size_t i = 0; i < values.size(); ++i)
      out << name_of(s) << "," << axis->at(static_cast<double>(i)) << ",," << values[i] << "\n";
  };
  put_profile(Sensor::spd, r.spd);
  put_profile(Sensor::radar, r.radar);
  if (has_array) {
    const auto range = run.axis("array");
    for (std::size_t b = 0; b < range->count; ++b)
      for (std::size_t k = 0; k < beams; ++k)
        out << "array," << range->at(static_cast<double>(b)) << "," << beam_cosine(k) << ","
            << beam_power(bin_of(r.array, antennas.size(), b), antennas, beam_cosine(k)) << "\n";
  }
  const auto x = run.axis("depth_x"), y = run.axis("depth_y");
  for (std::size_t i = 0; i < r.depth_mm.size(); ++i)
    out << "depth," << x->at(static_cast<double>(i % x->count)) << ","
        << y->at(static_cast<double>(i / x->count)) << "," << r.depth_mm[i] << "\n";
  out.close();
  if (!out) throw Error(ExitCode::disk, staged.path() + ": cannot write");
  staged.publish();
}

}  // namespace echofuse::record

// SPDX-License-Identifier: MIT
#include "acquire/import/array_folder.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <numeric>

#include "acquire/measurement/radar_array.hpp"
#include "acquire/record/fused_record.hpp"
#include "drivers/core/median.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

namespace fs = std::filesystem;

// Maximum number of values in a histogram or range profile, and of pixels in a depth image.
constexpr std::size_t max_points = 1u << 24, max_pixels = 1u << 23;

// Returns the smallest factor up to 1000 by which all counts become whole numbers, or 0 if there is
// no such factor. If the counts are means of f exposures, the factor is f.
std::uint32_t factor_of(const std::vector<double>& counts) {
  constexpr std::uint32_t max_factor = 1000;
  constexpr double rounding = 1e-6;  // relative rounding error of a float
  const auto whole = [](double v, double count) {
    return std::abs(v - std::round(v)) <= rounding * std::max(100.0, v) && (v >= 0.5 || count == 0);
  };
  for (std::uint32_t factor = 1; factor <= max_factor; ++factor)
    if (std::ranges::all_of(counts, [&](double count) { return whole(factor * count, count); }))
      return factor;
  return 0;
}

record::Antennas antennas_of(const std::vector<std::string>& texts, const std::string& path) {
  record::Antennas out;
  for (const std::string& text : texts) {
    const auto n = numbers_in(text);
    record::Antenna& a = out.emplace_back();
    if (n.size() >= 2) a.x = n[0], a.y = n[1];
    if (n.size() > 2) a.gain = n[2];
    if (n.size() > 3) a.phase_rad = n[3];
    if (n.size() < 2 || n.size() > 4 || !a.plausible() || out.size() > record::max_antennas)
      throw Error(ExitCode::config, printable(path) + ": radar.antennas has \"" +
                                        printable(text, 40) + "\"; expected at most " +
                                        std::to_string(record::max_antennas) +
                                        " strings \"X Y\" or \"X Y GAIN PHASE\", with a gain from "
                                        "0.001 to 1000 and other numbers below 1000");
  }
  return out;
}

Zone zone_of(const std::string& text, const std::string& path) {
  const auto n = numbers_in(text);
  Zone z;
  if (n.size() >= 3) z.x = n[0], z.y = n[1], z.width = n[2];
  if (n.size() == 4) z.zero_ps = n[3];
  if (n.size() < 3 || n.size() > 4 || !z.plausible())
    throw Error(ExitCode::config, printable(path) + ": spd.zones has \"" + printable(text, 40) +
                                      "\"; expected \"X Y WIDTH\" or \"X Y WIDTH ZERO_PS\"");
  return z;
}

}  // namespace

void bind(Settings& settings, ArraySettings& s) {
  settings.add("run", s.run, "source run; values without an array are copied from it");
  settings.add("window_s", s.window_s, 1e-6, 1e6, "slot length");
  settings.add("label", s.label, "label of all records");
  settings.add("labels", s.labels, "labels, one per record; override `label`");
  settings.add("notes", s.notes, "notes, such as the origin of the arrays");
  settings.add("spd.first_bin_ps", s.first_bin_ps, -1e9, 1e9, "start of bin 0, two-way time");
  settings.add("spd.bin_width_ps", s.bin_width_ps, 1e-3, 1e9, "width of a bin, two-way time");
  settings.add("spd.irf_fwhm_ps", s.irf_fwhm_ps, 0, 1e6,
               "FWHM of the impulse response; 0: unknown");
  settings.add("spd.zones", s.zones,
               "zones of spd.npy [n, zones, bins]: tangents of centre and width, optionally "
               "the time zero in ps; nan nan nan: unknown direction");
  settings.add("radar.first_m", s.first_m, -1e4, 1e4, "range of point 0");
  settings.add("radar.step_m", s.step_m, 1e-6, 1e4, "distance between points");
  settings.add("radar.cell_m", s.radar_cell_m, 0, 1e3,
               "range resolution c / 2B; 0: response unknown");
  settings.add(
      "radar.taps", s.radar_taps,
      "power in steps of 1/4 cell; the peak is 1, and comes first if the flanks are equal");
  settings.add(
      "radar.antennas", s.antennas,
      "antennas of array.npy: x and y in half wavelengths, optionally gain and phase in rad");
  settings.add("radar.array_frames", s.array_frames, 1, 1'000'000,
               "number of frames that a row of array.npy averages");
  for (const Sensor sensor : {Sensor::spd, Sensor::radar})
    settings.add(std::string(name_of(sensor)) + ".offset_m", s.offset_m[sensor], -1e3, 1e3,
                 "range bias to subtract, in addition to that of the source run");
  settings.add("depth.unit", s.depth_unit,
               "unit of depth.npy; default: mm for integers, m for floats", {"", "mm", "m"});
  settings.add("depth.half_tangent", s.half_tangent, record::min_map_half_tangent,
               record::max_map_half_tangent,
               "|x/z| at the left and right edges of the depth image");
  settings.add("depth.map_z_max_m", s.far_m, record::min_map_far_m, record::max_map_far_m,
               "largest depth; farther pixels have no return");
  settings.add("depth.map_size", s.map_size, 0, record::max_map_size,
               "width and height of the maps, pixels; 0: size of the images, or 64");
  bind_limits(settings, s.limits);
}

ArrayFolder::ArrayFolder(const std::string& folder, const ArraySettings& settings)
    : folder_(folder),
      settings_(settings),
      antennas_(antennas_of(settings.antennas, folder + "/run.toml")),
      samples_(settings.window_s, [this](Sensor sensor, const std::string& text) {
        reported_.push_back(std::string(name_of(sensor)) + ": " + text);
      }) {
  const bool of_run = !settings_.run.empty();
  spd_ = open("spd.npy", 2, 3), radar_ = open("radar.npy", 2), depth_ = open("depth.npy", 3);
  array_ = open("array.npy", 3), index_ = open("index.npy", 1), valid_ = open("valid.npy", 1);
  const auto config_error = [&](const std::string& what) {
    throw Error(ExitCode::config, printable(folder) + "/run.toml: " + what);
  };
  if (!spd_ && !radar_ && !of_run)
    throw Error(
        ExitCode::failed,
        printable(folder) + ": contains neither spd.npy [n, bins] nor radar.npy [n, points]");
  if (rows_ == 0)
    throw Error(ExitCode::failed,
                printable(first_ ? *first_ : folder) + ": has no rows; nothing to import");
  if (of_run ? depth_ || array_ : index_ || valid_)
    config_error(of_run ? "depth.npy and array.npy cannot be combined with `run`"
                        : "index.npy and valid.npy need `run`");
  if (!settings_.labels.empty() && settings_.labels.size() != rows_)
    config_error(std::to_string(settings_.labels.size()) + " labels, but there are " +
                 std::to_string(rows_) + " records");
  if (settings_.map_size > 0 && settings_.map_size < record::min_map_size)
    config_error("depth.map_size = " + std::to_string(settings_.map_size) +
                 "; expected 0, or 3 to 256");
  if (array_ && (!radar_ || antennas_.empty() || array_->shape()[1] != axes().back().count ||
                 array_->shape()[2] != record::values_of_bin(antennas_.size())))
    refuse(*array_, "its shape is " + array_->shape_text() +
                        "; expected a shape that matches radar.npy and radar.antennas, with " +
                        std::to_string(record::values_of_bin(antennas_.size())) +
                        " values in each of the bins up to " +
                        std::to_string(std::lround(record::array_end_m)) + " m");
  zones_ = stated_zones();
  for (const Axis& axis : of_run ? std::vector<Axis>{} : axes()) samples_.take(axis);
  if (depth_)
    millimetres_ =
        settings_.depth_unit.empty() ? depth_->is_integer() : settings_.depth_unit == "mm";
}

std::unique_ptr<NpyFile> ArrayFolder::open(const char* name, std::size_t dimensions,
                                           std::size_t most) {
  const std::string path = (fs::path(folder_) / name).string();
  if (!fs::exists(path)) return nullptr;
  auto file = std::make_unique<NpyFile>(path);
  const std::size_t found = file->shape().size();
  if (found < dimensions || found > std::max(dimensions, most) || file->row_size() == 0)
    refuse(*file, "its shape is " + file->shape_text() + "; expected " +
                      std::to_string(dimensions) + " dimensions, one row per record" +
                      (most > 0 ? ", or 3: [records, zones, bins]" : ""));
  const std::size_t max_size = std::string(name) == "depth.npy" ? max_pixels : max_points;
  if (file->row_size() > max_size)
    refuse(*file, "has " + std::to_string(file->row_size()) +
                      " values per record; expected at most " + std::to_string(max_size));
  if (!first_) first_ = newest_ = path, rows_ = file->rows();
  if (fs::last_write_time(path) > fs::last_write_time(newest_)) newest_ = path;
  if (file->rows() != rows_)
    refuse(*file, "has " + std::to_string(file->rows()) + " rows, but " + printable(*first_) +
                      " has " + std::to_string(rows_));
  return file;
}

Zones ArrayFolder::stated_zones() const {
  const std::size_t found = spd_ && spd_->shape().size() == 3 ? spd_->shape()[1] : 1;
  if (found > max_zones)
    refuse(*spd_, "has " + std::to_string(found) + " zones; expected at most " +
                      std::to_string(max_zones));
  Zones out;
  for (const std::string& text : settings_.zones)
    out.push_back(zone_of(text, folder_ + "/run.toml"));
  if (!out.empty() && (!spd_ || out.size() != found))
    throw Error(ExitCode::config,
                printable(folder_) + "/run.toml: spd.zones has " + std::to_string(out.size()) +
                    " zones; expected " +
                    (spd_ ? std::to_string(found) + ", as in spd.npy " + spd_->shape_text()
                          : "spd.npy [n, zones, bins]"));
  return out.empty() ? Zones(found) : out;
}

void ArrayFolder::refuse(const NpyFile& file, const std::string& what) const {
  throw Error(ExitCode::failed, printable(file.path()) + ": " + what);
}

void ArrayFolder::refuse_row(const NpyFile& file, const std::string& what) const {
  refuse(file, "row " + std::to_string(row_) + " has " + what);
}

std::vector<Axis> ArrayFolder::axes() const {
  std::vector<Axis> out;
  // The array dimensions fit in 32 bits, because open() limits the size of an array.
  const auto count = [](const NpyFile& f, std::size_t k) {
    return static_cast<std::uint32_t>(f.shape()[k]);
  };
  const ArraySettings& s = settings_;
  if (spd_)
    out.push_back(
        spd_axis(count(*spd_, spd_->shape().size() - 1), s.first_bin_ps, s.bin_width_ps, zones_));
  if (depth_) {
    const auto height = count(*depth_, 1), width = count(*depth_, 2);
    const double up = s.half_tangent * height / width;
    out.push_back(record::depth_x_axis(width, s.half_tangent));
    out.push_back(record::depth_y_axis(height, up));
    const bool fits =
        height == width && width >= record::min_map_size && width <= record::max_map_size;
    record::MapGrid grid;
    grid.half_tangent = s.half_tangent, grid.far_m = s.far_m;
    if (s.map_size > 0 || fits)
      grid.size = s.map_size > 0 ? static_cast<std::uint32_t>(s.map_size) : width;
    for (const Axis& axis : grid.axes()) out.push_back(axis);
  }
  if (radar_) {
    out.push_back(range_axis("power", count(*radar_, 1), s.first_m, s.step_m));
    if (array_) out.push_back(record::array_axis(out.back(), antennas_.size()));
  }
  return out;
}

void ArrayFolder::require_shapes(const std::vector<Axis>& axes) const {
  for (const auto& [file, name] : {std::pair{spd_.get(), "spd"}, {radar_.get(), "radar"}}) {
    const Axis* const axis = find_axis(axes, name);
    const std::size_t values = axis ? axis->values() : 0;
    if (file && file == spd_.get() && axis && axis->zones.size() != zones_.size())
      refuse(*file, "its shape is " + file->shape_text() + "; the source run has " +
                        std::to_string(axis->zones.size()) + " zones");
    if (file && file->row_size() != values)
      refuse(*file, "has " + std::to_string(file->row_size()) +
                        " values per record; in the source run, " + name + " has " +
                        std::to_string(values));
  }
}

std::int64_t ArrayFolder::next_index() {
  return static_cast<std::int64_t>(
      index_ ? next_integer(*index_, static_cast<double>(record::max_index)) : row_);
}

// Returns the only value of the next row. Throws Error(failed) if it is not a whole number between
// 0 and `maximum`.
std::uint64_t ArrayFolder::next_integer(NpyFile& file, double maximum) const {
  const double value = file.next_row().at(0);
  if (value >= 0 && value <= maximum && value == std::floor(value))
    return static_cast<std::uint64_t>(value);
  refuse_row(file, std::to_string(value) + "; expected a whole number from 0 to " +
                       std::to_string(std::llround(maximum)));
}

void ArrayFolder::take_row(record::FusedRecord& r) {
  const bool of_run = !settings_.run.empty();
  if (!of_run) {
    r.label = settings_.labels.empty() ? settings_.label : settings_.labels[row_];
    for (const auto& [file, sensor] : {std::pair{spd_.get(), Sensor::spd},
                                       {radar_.get(), Sensor::radar},
                                       {depth_.get(), Sensor::depth}})
      if (!file) r.sync[sensor].verdict.kind = record::VerdictKind::not_configured;
  }
  if (spd_) put_counts(r);
  if (radar_) put_power(r);
  if (depth_) put_depth(r);
  if (valid_) {
    constexpr double all_bits = 7;
    const auto bits = static_cast<std::uint32_t>(next_integer(*valid_, all_bits));
    for (const Sensor s : all_sensors)
      if (r.has(s) && !SensorSet::from_bits(bits).contains(s))
        r.valid.erase(s), r.sync[s].verdict = {};
  }
  ++row_;
}

// Returns the values of the next row; empty if all are NaN. Throws Error(failed) if a value is
// below `minimum`, which is negative for power because noise subtraction can make power negative.
std::vector<double> ArrayFolder::read(NpyFile& file, double minimum, const char* what) const {
  std::vector<double> values = file.next_row();
  if (std::ranges::all_of(values, [](double v) { return std::isnan(v); })) return {};
  const auto bad =
      std::ranges::find_if(values, [&](double v) { return !(v >= minimum && is_power(v)); });
  if (bad != values.end())
    refuse_row(file, format("%g", *bad) + "; expected " + what +
                         ", or NaN in the whole row for a missing sensor");
  // Smaller numbers lose digits when they are stored as floats.
  const double largest =
      std::abs(*std::ranges::max_element(values, {}, [](double v) { return std::abs(v); }));
  if (largest > 0 && largest < min_radar_power)
    refuse_row(file, format("at most %g; expected values from %g to %g; multiply all rows by the "
                            "same factor",
                            largest, min_radar_power, double{max_radar_power}));
  return values;
}

// Marks the sensor as valid. A record that comes from a source run keeps its times, and the verdict
// on data that are not `replaced`. Losses stay, because they cannot be assessed again.
void ArrayFolder::mark(record::FusedRecord& r, Sensor sensor, std::uint64_t used,
                       bool replaced) const {
  record::Verdict& verdict = r.sync[sensor].verdict;
  if (settings_.run.empty()) {
    r.valid.insert(sensor);
    r.sync[sensor] = {0, settings_.window_s, used, 0, record::ok_verdict, used};
  } else if (replaced && verdict.kind != record::VerdictKind::lossy) {
    verdict = record::ok_verdict;
  }
}

void ArrayFolder::put_counts(record::FusedRecord& r) {
  const std::vector<double> values = read(
      *spd_, 0, "counts of 0 or more (if the background was subtracted, add it to all bins again)");
  if (values.empty()) return;
  if (std::ranges::max(values) > std::numeric_limits<std::uint32_t>::max())
    refuse_row(*spd_, "a count that exceeds 32 bits");
  const std::uint32_t factor = spd_->is_integer() ? 1 : factor_of(values);
  if (factor != 1)
    refuse_row(*spd_, "non-integer counts; expected photons per bin: " +
                          (factor > 1 ? "multiply by " + std::to_string(factor) +
                                            " if each row is the mean over that number of exposures"
                                      : "multiply a normalised histogram by its photon number"));
  std::vector<std::uint32_t> counts;
  for (const double v : values) counts.push_back(static_cast<std::uint32_t>(std::llround(v)));
  if (settings_.run.empty() && !samples_.take(counts, settings_.window_s)) {
    r.sync[Sensor::spd].lost = 1;
    r.sync[Sensor::spd].verdict.kind = record::VerdictKind::no_histograms;
    return;
  }
  if (counts == r.spd) return;
  r.spd = std::move(counts);
  const std::uint64_t all = std::accumulate(r.spd.begin(), r.spd.end(), std::uint64_t{0});
  r.spd_counts.in_range = r.sync[Sensor::spd].used = all;
  if (settings_.run.empty()) r.spd_counts.tags = all;
  mark(r, Sensor::spd, all, true);
}

void ArrayFolder::put_power(record::FusedRecord& r) {
  const std::vector<double> values = read(*radar_, -max_radar_power, "power below 1e38");
  const std::vector<double> array =
      array_ ? read(*array_, -max_radar_power, "numbers below 1e38") : std::vector<double>{};
  if (values.empty()) return;
  RadarFrame frame;
  frame.power.assign(values.begin(), values.end());
  if (settings_.run.empty()) {
    samples_.take(frame);
    if (frame.power.empty()) {
      r.sync[Sensor::radar].verdict.kind = record::VerdictKind::no_profile;
      return;
    }
  }
  const bool replaced = frame.power != r.radar;
  r.radar = std::move(frame.power);
  mark(r, Sensor::radar, 1, replaced);
  if (array.empty()) return;
  for (std::size_t i = 0; i < array.size(); ++i)
    if (const auto at = i % record::values_of_bin(antennas_.size());
        at >= 2 * antennas_.size() && at < 3 * antennas_.size() && array[i] < 0)
      refuse_row(*array_, format("the antenna power %g; expected powers of 0 or more", array[i]));
  r.array.assign(array.begin(), array.end());
  r.array_frames = static_cast<std::uint64_t>(settings_.array_frames);
}

void ArrayFolder::put_depth(record::FusedRecord& r) {
  const std::vector<double> values = depth_->next_row();
  if (std::ranges::all_of(values, [](double v) { return std::isnan(v); })) return;
  ++maps_;
  const std::string odd = take_depth(r, values);
  if (odd.empty()) return mark(r, Sensor::depth, 1, true);
  r.depth_mm.clear();
  r.sync[Sensor::depth].verdict = {record::VerdictKind::odd, odd};
  if (odd_maps_++ == 0)
    first_odd_ = printable(depth_->path()) + ": row " + std::to_string(row_) + ": " + odd;
}

// Fills the depth map of the record. Returns the reason if the map is implausible; otherwise an
// empty string.
std::string ArrayFolder::take_depth(record::FusedRecord& r,
                                    const std::vector<double>& values) const {
  constexpr double max_mm = std::numeric_limits<std::uint16_t>::max();
  std::vector<double> returns;
  for (const double v : values) {
    double mm = std::isnan(v) ? 0 : v * (millimetres_ ? 1 : 1000);
    if (!(mm >= 0 && mm <= max_mm))
      return "a depth of " + std::to_string(mm / 1000) + " m; expected 0 to 65.5 m" +
             (millimetres_ ? "" : ", or depth.unit = \"mm\"");
    // Some cameras report the largest value for pixels without a return.
    if (millimetres_ && mm == max_mm) mm = 0;
    r.depth_mm.push_back(static_cast<std::uint16_t>(std::lround(mm)));
    if (mm > 0) returns.push_back(mm);
  }
  if (returns.empty()) return {};
  const std::string fault = fault_of_depths(median(std::move(returns)));
  if (fault.empty()) return {};
  return fault + (millimetres_ ? "millimetres (for metres set depth.unit = \"m\")" : "metres");
}

std::vector<std::string> ArrayFolder::doubts() {
  if (2 * odd_maps_ > maps_) throw Error(ExitCode::failed, first_odd_);
  samples_.finish();
  std::vector<std::string> out = reported_;
  if (odd_maps_ > 0)
    out.push_back("depth: " + std::to_string(odd_maps_) + " of " + std::to_string(maps_) +
                  " maps are implausible and were omitted; the first: " + first_odd_);
  return out;
}

}  // namespace echofuse::acquire

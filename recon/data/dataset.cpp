// SPDX-License-Identifier: MIT
#include "recon/data/dataset.hpp"

#include <sys/mman.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <optional>

#include "acquire/measurement/detector.hpp"
#include "acquire/record/run_names.hpp"
#include "drivers/core/crc32c.hpp"
#include "drivers/util/printable.hpp"
#include "recon/data/copies.hpp"
#include "recon/data/depth_check.hpp"
#include "recon/data/lags.hpp"
#include "recon/data/pile_up.hpp"
#include "recon/data/shift.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {

std::string to_text(const DamagedRecord& damaged) {
  return printable(damaged.path) + ": record " + std::to_string(damaged.index) + ": " +
         printable(damaged.why);
}

namespace {

Error map_error(const std::string& path, const record::MapGrid& found,
                const record::MapGrid& expected, const std::string& owner) {
  return {ExitCode::failed, printable(path) + ": depth maps have " + found.text() + "; " +
                                printable(owner) + " has " + expected.text()};
}

// Asks the kernel for huge pages, because handling the page faults of 4 KiB pages takes a sixth of
// the loading time. The kernel may ignore this request.
void advise_large_pages(void* begin, std::size_t size) {
  constexpr std::size_t page = 4096;
  auto* const first = static_cast<std::byte*>(begin);
  const std::size_t before = -reinterpret_cast<std::uintptr_t>(begin) % page;
  if (size > before + page) ::madvise(first + before, (size - before) / page * page, MADV_HUGEPAGE);
}

class Appender {
 public:
  Appender(Dataset& data, const record::RunHead& run, SensorSet sensors, DepthCheck* depths)
      : data_(data), path_(run.path), sensors_(sensors), depths_(depths) {
    Axis array;
    for (const Axis& axis : run.axes) {
      if (axis.name == "spd" && sensors_.contains(Sensor::spd)) spd_ = axis;
      if (axis.name == "radar" && sensors_.contains(Sensor::radar)) radar_ = axis;
      if (axis.name == "array" && sensors_.contains(Sensor::radar)) array = axis;
      if (axis.name == "depth_x") x_ = axis;
      if (axis.name == "depth_y") y_ = axis;
    }
    subtracts_noise_ = radar_.quantity == "power_with_noise";
    if (subtracts_noise_) radar_.quantity = "power";
    pile_up_ = PileUp(run.info, spd_);
    if (array.count > 0) {
      antennas_ = record::antennas_of(array), lags_ = SpatialLags(run.antennas);
      array_ = lags_axis(array, lags_);
    }
    adopt(data.spd(), spd_, "spd");
    adopt(data.radar(), radar_, "radar");
    adopt_array();
    adopt_map(run.axes);
    double radar_offset_m = 0, range_error_m = 0;
    SensorSet calibrated;
    for (const auto& c : run.calibrations) {
      calibrated.insert(c.sensor), range_error_m = std::hypot(range_error_m, c.standard_error_m);
      if (c.sensor == Sensor::spd && data.spd().axis.unit == "ps")
        spd_offset_ps_ = c.offset_m * ps_per_m;
      if (c.sensor == Sensor::radar && data.radar().axis.unit == "m") radar_offset_m = c.offset_m;
    }
    for (const Zone& zone : spd_.zones) {
      const double ps = spd_offset_ps_ + zone.zero_ps;
      shifts_.push_back(ps == 0 ? std::nullopt : std::optional<Shift>(ps / spd_.step));
    }
    const record::RunInfo& info = run.info;
    for (const Source& other : data.sources)
      if (other.uuid == info.uuid)
        throw Error(ExitCode::failed,
                    printable(path_) + ": is the same run as " + printable(other.path) +
                        "; remove the copy, or its records leak into the test set");
    Source& source = data.sources.emplace_back(
        Source{path_, info.uuid, data.size(), 0, radar_offset_m, RunResponse::read(info.meta)});
    if (calibrated.contains(Sensor::spd) && calibrated.contains(Sensor::radar))
      source.calibration_error_m = range_error_m;
    source.mounting = record::radar_mounting_of(info.meta);
  }

  // Reserves memory for the given number of records, because reallocation would copy the tables. At
  // least doubles the capacity, so that loading many runs needs few reallocations.
  void make_room(std::size_t records) {
    for (Column& column : data_.columns) {
      const std::size_t needed = column.values.size() + records * column.axis.size();
      if (needed > column.values.capacity())
        column.values.reserve(std::max(needed, 2 * column.values.capacity()));
      advise_large_pages(column.values.data(), column.values.capacity() * sizeof(float));
    }
  }

  // Appends one record. Returns why the record is invalid, or an empty string if it was added.
  std::string add(const record::FusedRecord& r) {
    if (const std::string fault = absurd_counts(r); !fault.empty()) return fault;
    double a_pulse = r.clicks_per_pulse();
    const std::vector<float> spd = photons(r, a_pulse);
    std::vector<float> radar;
    if (r.has(Sensor::radar)) radar = r.radar;
    if (r.has(Sensor::radar) && subtracts_noise_) subtract_median(radar);
    const std::vector<float> lags = lags_of(r);
    if (!std::ranges::all_of(radar, is_power) || !std::ranges::all_of(lags, is_power))
      return "a radar value is not a finite power";
    if (depths_ && r.has(Sensor::depth)) depths_->add(r.depth_mm, data_.map.far_m);
    add_row(data_.spd(), spd, spd_);
    add_row(data_.radar(), radar, radar_);
    add_row(data_.array(), lags, array_);
    Column& depth = data_.depth();
    add_row(depth, {}, depth.axis);
    if (r.has(Sensor::depth))
      record::to_target(r.depth_mm, x_, y_, data_.map, depth.row(depth.rows - 1));
    RecordInfo& info = data_.records.emplace_back();
    info = {.valid = r.valid,
            .index = r.index,
            .slot_end = r.slot_end,
            .clicks_per_pulse = a_pulse,
            .label = r.label};
    for (const Sensor s : all_sensors) info.verdicts[s] = r.sync[s].verdict.kind;
    using enum record::VerdictKind;
    if (const auto kind = info.verdicts[Sensor::spd]; kind != weak && kind != stands_still)
      info.content = fingerprint_of(r);
    ++data_.sources.back().count;
    return {};
  }

 private:
  // Returns the photon counts of all zones, with the range offset subtracted.
  // Sets `a_pulse` (clicks per laser pulse) to 0 if pile-up was corrected.
  std::vector<float> photons(const record::FusedRecord& r, double& a_pulse) const {
    if (!r.has(Sensor::spd)) return {};
    const auto clicks = static_cast<double>(r.spd_counts.in_range + r.spd_counts.out_of_range);
    const double pulses = pile_up_.known() && a_pulse > 0 ? clicks / a_pulse : 0;
    // Smallest fraction, over all zones and bins, of laser pulses for which the detector is ready.
    double ready = 1;
    std::vector<float> out;
    for (std::size_t z = 0; z < shifts_.size(); ++z) {
      const auto first = r.spd.begin() + static_cast<std::ptrdiff_t>(z * spd_.count);
      std::vector<float> zone(first, first + spd_.count);
      if (pulses > 0) ready = std::min(ready, pile_up_.correct(zone, pulses));
      if (shifts_[z]) {
        zone = shifts_[z]->apply(zone);
        for (float& count : zone)
          count = std::max(count, 0.0F);  // the interpolation may undershoot
      }
      if (z == 0)
        out = std::move(zone);
      else
        out.insert(out.end(), zone.begin(), zone.end());
    }
    // Minimum fraction of pulses for which the detector is ready. If the fraction is smaller, the
    // pile-up correction mainly amplifies noise.
    constexpr double hardly_any = 0.03;
    if (pulses > 0 && ready > hardly_any) a_pulse = 0;
    return out;
  }
  static std::string absurd_counts(const record::FusedRecord& r) {
    const double slot_s = seconds(r.slot_end - r.slot_start);
    for (std::size_t i = 0; i < r.spd.size(); ++i)
      if (r.spd[i] == std::numeric_limits<std::uint32_t>::max() ||
          (slot_s > 0 && r.spd[i] > record::max_clicks_per_s * slot_s))
        return "spd bin " + std::to_string(i) + " contains " + std::to_string(r.spd[i]) +
               " clicks, more than a time tagger can send";
    return {};
  }
  void adopt(Column& column, ColumnAxis& found, const char* name) {
    found.name = name;
    if (data_.sources.empty()) {
      column.axis = found;
    } else if (!agree(found, column.axis) &&
               !(column.axis.count > 0 && is_near(found, column.axis))) {
      throw axis_error(path_, found, column.axis, data_.sources.front().path);
    }
  }
  void adopt_array() {
    Column& column = data_.array();
    if (data_.sources.empty()) column.axis = array_;
    column.differs = column.differs || !is_near(array_, column.axis);
    if (column.differs) drop_array(data_);
  }
  void adopt_map(const std::vector<Axis>& axes) {
    if (!sensors_.contains(Sensor::depth)) return;
    record::MapGrid found;
    try {
      found = record::map_grid_of(axes);
    } catch (const Error& error) {
      throw Error(error.code(), printable(path_) + ": " + error.what());
    }
    if (data_.sources.empty()) data_.map = found;
    if (!(found == data_.map)) throw map_error(path_, found, data_.map, data_.sources.front().path);
    data_.depth().axis.count = static_cast<std::uint32_t>(data_.map.pixels());
  }
  // Interpolates a row onto the axis of the first run, and appends it to the column. The row of a
  // missing sensor contains zeros.
  static void add_row(Column& column, std::span<const float> row, const ColumnAxis& found) {
    column.cols = column.axis.size();
    if (row.empty() || agree(found, column.axis))
      column.add_row(row.first(std::min(row.size(), column.cols)));
    else
      column.add_row(resampled(row, found, column.axis));
    column.values.resize(column.rows * column.cols);
  }

  // Returns the spatial lags; empty if the record has no antenna samples.
  std::vector<float> lags_of(const record::FusedRecord& r) const {
    std::vector<float> out;
    if (data_.array().axis.count == 0 || r.array.empty() || !r.has(Sensor::radar)) return out;
    out.resize(array_.size());
    lags_(r.array, antennas_, out);
    return out;
  }

  Dataset& data_;
  std::string path_;
  SensorSet sensors_;
  DepthCheck* depths_;  // null if depth images are not checked
  ColumnAxis spd_, radar_, array_;
  Axis x_, y_;
  std::size_t antennas_ = 0;
  bool subtracts_noise_ = false;
  SpatialLags lags_;
  PileUp pile_up_;
  double spd_offset_ps_ = 0;
  // One entry per zone; an entry is empty if its zone needs no shift.
  std::vector<std::optional<Shift>> shifts_;
};

void append(Dataset& data, const record::RunReader& run, std::int64_t first, std::size_t at_most,
            SensorSet sensors, const OnBadRecord& on_bad,
            const record::RunReader::InParallel& in_parallel = {}, DepthCheck* depths = nullptr) {
  // Created when the first record is read, because until then, axes may be added to a run that is
  // being recorded.
  std::optional<Appender> appender;
  const auto to = [&]() -> Appender& {
    if (appender) return *appender;
    appender.emplace(data, *run.head(), sensors, depths);
    appender->make_room(at_most);
    return *appender;
  };
  std::size_t left = at_most;
  run.for_each(
      [&](const record::FusedRecord& r) {
        const std::string fault = to().add(r);
        if (!fault.empty() && !on_bad)
          throw Error(ExitCode::failed,
                      printable(run.path()) + ": record " + std::to_string(r.index) + ": " + fault);
        if (!fault.empty()) on_bad(r.index, fault);
        return --left > 0;
      },
      first, on_bad, sensors, in_parallel);
  to();
}

}  // namespace

Dataset load_recorded(const std::vector<std::string>& paths) {
  std::vector<std::string> files;
  for (const auto& path : paths) files.push_back(record::old_run(path));
  require_memory(files);
  Dataset data;
  const auto depths = std::make_unique<DepthCheck>();
  for (const auto& path : files) {
    const record::RunReader run(path);
    const auto note = [&](std::int64_t index, const std::string& fault) {
      data.damaged.push_back({path, index, fault});
    };
    append(data, run, 0, static_cast<std::size_t>(run.count()),
           {Sensor::spd, Sensor::radar, Sensor::depth}, note, for_each_part, depths.get());
  }
  if (const std::string warning = depths->text(paths.front(), data.spd().axis); !warning.empty())
    std::fprintf(stderr, "%s\n", warning.c_str());
  const std::size_t damaged = data.damaged.size(), all = data.size() + damaged;
  if (static_cast<double>(damaged) > max_damaged * static_cast<double>(all))
    throw Error(ExitCode::failed, to_text(data.damaged.front()) + "; " + std::to_string(damaged) +
                                      " of " + std::to_string(all) +
                                      " records are dead or damaged (limit 10 %)");
  return data;
}

std::uint32_t crc32c_of(const Dataset& data) {
  std::uint32_t out = 0;
  for (const Column& column : data.columns)
    out = crc32c({reinterpret_cast<const std::uint8_t*>(column.values.data()),
                  column.values.size() * sizeof(float)},
                 out);
  return out;
}

Dataset load(const std::vector<std::string>& paths) {
  Dataset data = load_recorded(paths);
  subtract_range_offset(data, 0);
  data.hash = crc32c_of(data);
  return data;
}

Dataset load_part(const record::RunReader& run, std::int64_t first, std::size_t at_most,
                  SensorSet sensors, const OnBadRecord& on_bad) {
  Dataset data;
  append(data, run, first, at_most, sensors, on_bad);
  return data;
}

Dataset load_record(const record::RunHead& run, record::FusedRecord record, SensorSet sensors,
                    std::string& fault) {
  Dataset data;
  record.valid = SensorSet::from_bits(record.valid.bits() & sensors.bits());
  if (!record.has(Sensor::spd)) record.spd.clear();
  fault = Appender(data, run, sensors, nullptr).add(record);
  return data;
}

void subtract_range_offset(Dataset& data, double offset_m) {
  std::vector<double> by_m(data.size(), offset_m);
  for (Source& source : data.sources) {
    const std::size_t end = std::min(source.first + source.count, data.size());
    for (std::size_t i = source.first; i < end; ++i) by_m[i] += source.radar_offset_m;
    source.radar_offset_m = 0;
  }
  std::optional<Shift> shift;
  for (std::size_t row = 0; row < data.size(); ++row) {
    if (by_m[row] == 0) continue;
    if (!shift || by_m[row] != by_m[row - 1]) shift.emplace(by_m[row] / data.radar().axis.step);
    for (Column& column : data.columns)
      if (column.sensor == Sensor::radar)
        shift->apply(column.row(row), column.axis.values_per_bin());
  }
}

void require_map(const Dataset& data, const record::MapGrid& grid, const std::string& owner) {
  if (data.map == grid || data.depth().cols == 0) return;
  for (std::size_t row = 0; row < data.size(); ++row)
    if (data.has(row, Sensor::depth)) throw map_error(data.path(), data.map, grid, owner);
}

}  // namespace echofuse::recon

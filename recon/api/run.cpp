// SPDX-License-Identifier: MIT
#include "echofuse/run.hpp"

#include <algorithm>
#include <iterator>

#include "acquire/record/follow.hpp"
#include "acquire/record/run_names.hpp"
#include "recon/api/internals.hpp"

namespace echofuse {

RunAxis public_axis(const Axis& axis) {
  return {axis.name, axis.quantity, axis.unit, axis.count, axis.start, axis.step};
}

MapGrid public_grid(const record::MapGrid& grid) {
  return {grid.size, grid.half_tangent, grid.far_m};
}

namespace {

using Head = std::shared_ptr<const record::RunHead>;

SensorQuality quality_of(const record::FusedRecord& record, Sensor sensor) {
  const record::SensorSync& sync = record.sync[sensor];
  return {record.has(sensor),  static_cast<VerdictCode>(sync.verdict.kind),
          sync.verdict.word(), sync.verdict.figures,
          sync.used,           sync.lost};
}

StatusCode code_of(const std::string& status) {
  if (status == "open") return StatusCode::open;
  if (status == "complete") return StatusCode::complete;
  if (status == record::copy_of_open) return StatusCode::copy;
  return status.starts_with("crashed") ? StatusCode::crashed : StatusCode::stopped;
}

Record public_record(const Head& run, record::FusedRecord record) {
  std::vector<float> map;
  if (record.has(Sensor::depth))
    map = to_target(record.depth_mm, run->axis("depth_x").value_or(Axis{}),
                    run->axis("depth_y").value_or(Axis{}), record::map_grid_of(run->axes));
  return Internals::record(
      std::make_shared<Internals::RecordContents>(std::move(record), std::move(map), run));
}

template <class T, class Rows, class Convert>
std::vector<T> public_list(const Rows& rows, const Convert& convert) {
  std::vector<T> out;
  std::ranges::transform(rows, std::back_inserter(out), convert);
  return out;
}

}  // namespace

std::int64_t Record::index() const { return contents_->record.index; }
std::chrono::sys_time<std::chrono::nanoseconds> Record::time() const {
  return std::chrono::sys_time<std::chrono::nanoseconds>(contents_->record.slot_utc);
}
std::chrono::nanoseconds Record::length() const {
  return contents_->record.slot_end - contents_->record.slot_start;
}
const std::string& Record::label() const { return contents_->record.label; }
SensorQuality Record::spd_quality() const { return quality_of(contents_->record, Sensor::spd); }
SensorQuality Record::radar_quality() const { return quality_of(contents_->record, Sensor::radar); }
SensorQuality Record::depth_quality() const { return quality_of(contents_->record, Sensor::depth); }
std::span<const std::uint32_t> Record::spd() const { return contents_->record.spd; }
std::span<const float> Record::radar() const { return contents_->record.radar; }
std::span<const float> Record::array() const { return contents_->record.array; }
std::span<const float> Record::map() const { return contents_->map; }

Run::Run(const std::string& path)
    : file_(guarded(ErrorCode::damaged, [&] {
        return std::make_shared<File>(path,
                                      std::make_shared<record::RunReader>(record::old_run(path)));
      })) {}

const std::string& Run::path() const { return file_->path; }

RunInfo Run::info() const {
  record::RunInfo info = guarded(ErrorCode::damaged, [&] { return file_->reader->info(); });
  const StatusCode code = code_of(info.status);
  return {std::move(info.uuid),
          std::move(info.started_utc),
          std::move(info.ended_utc),
          std::move(info.status),
          code,
          std::move(info.notes),
          info.window_s,
          std::move(info.meta)};
}

std::int64_t Run::count() const {
  return guarded(ErrorCode::damaged, [&] { return file_->reader->count(); });
}

std::optional<RunAxis> Run::axis(const std::string& name) const {
  const auto found = guarded(ErrorCode::damaged, [&] { return file_->reader->head()->axis(name); });
  return found ? std::optional(public_axis(*found)) : std::nullopt;
}

std::vector<DetectorZone> Run::zones() const {
  const Head run = guarded(ErrorCode::damaged, [&] { return file_->reader->head(); });
  const Zones zones = run->axis("spd").value_or(Axis{}).zones;
  if (zones == single_pixel()) return {};
  return public_list<DetectorZone>(zones, [](const Zone& zone) {
    return DetectorZone{zone.x, zone.y, zone.width, zone.zero_ps};
  });
}

std::vector<RadarAntenna> Run::antennas() const {
  const Head run = guarded(ErrorCode::damaged, [&] { return file_->reader->head(); });
  return public_list<RadarAntenna>(run->antennas, [](const record::Antenna& antenna) {
    return RadarAntenna{antenna.x, antenna.y, antenna.gain, antenna.phase_rad};
  });
}

std::vector<SensorCalibration> Run::calibrations() const {
  const Head run = guarded(ErrorCode::damaged, [&] { return file_->reader->head(); });
  return public_list<SensorCalibration>(
      run->calibrations, [](const record::CalibrationEntry& entry) {
        return SensorCalibration{name_of(entry.sensor), entry.date_utc, entry.method,
                                 entry.distance_m,      entry.offset_m, entry.standard_error_m};
      });
}

std::vector<RunEvent> Run::events() const {
  const auto events = guarded(ErrorCode::damaged, [&] { return file_->reader->events(); });
  return public_list<RunEvent>(events, [](const record::Event& event) {
    return RunEvent{event.utc, event.level, event.source, event.text};
  });
}

MapGrid Run::grid() const {
  return guarded(ErrorCode::damaged,
                 [&] { return public_grid(record::map_grid_of(file_->reader->head()->axes)); });
}

Record Run::read(std::int64_t index) const {
  return guarded(ErrorCode::damaged, [&] {
    // Reads the record before its axes, because the next record of a live run may add an axis.
    record::FusedRecord record = file_->reader->read(index);
    return public_record(file_->reader->head(), std::move(record));
  });
}

void Run::for_each(const std::function<bool(const Record&)>& visit, std::int64_t first,
                   const OnDamaged& on_damaged) const {
  Head run;
  guarded(ErrorCode::damaged, [&] {
    file_->reader->for_each(
        [&](const record::FusedRecord& record) {
          if (!run) run = file_->reader->head();
          return visit(public_record(run, record));
        },
        first, on_damaged);
  });
}

void follow(const std::string& path, const std::function<bool(const Run&, const Record&)>& visit,
            std::int64_t first, const std::function<bool()>& go_on, const OnDamaged& on_damaged) {
  bool going_on = true;
  const auto skip = [&](std::int64_t index, const std::string& fault) {
    first = index + 1;
    on_damaged(index, fault);
  };
  const auto take = [&](const record::RunReader& reader) {
    const std::int64_t before = first;
    const Run run = Internals::run(std::make_shared<Internals::RunFile>(
        path, std::shared_ptr<const record::RunReader>(std::shared_ptr<void>(), &reader)));
    run.for_each(
        [&](const Record& record) {
          first = record.index() + 1;
          going_on = visit(run, record) && (!go_on || go_on());
          return going_on;
        },
        first, on_damaged ? OnDamaged(skip) : OnDamaged());
    return first != before;
  };
  guarded(ErrorCode::damaged, [&] {
    record::follow(record::old_run(path), take, [&] { return going_on && (!go_on || go_on()); });
  });
}

}  // namespace echofuse

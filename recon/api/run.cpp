// SPDX-License-Identifier: MIT
#include "echofuse/run.hpp"

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

SensorReport report_of(const record::FusedRecord& record, Sensor sensor) {
  const record::SensorSync& sync = record.sync[sensor];
  return {record.has(sensor), sync.verdict.text(), sync.used, sync.lost};
}

// Converts records of one run to the types and units of the public interface.
class Converter {
 public:
  explicit Converter(const record::RunReader& run)
      : x_(run.axis("depth_x").value_or(Axis{})),
        y_(run.axis("depth_y").value_or(Axis{})),
        grid_(record::map_grid_of(run.axes())) {}

  Record operator()(const record::FusedRecord& record) const {
    auto out = std::make_shared<Internals::RecordContents>(record);
    if (record.has(Sensor::depth)) out->depth_m = to_target(record.depth_mm, x_, y_, grid_);
    return Internals::record(std::move(out));
  }

 private:
  Axis x_, y_;
  record::MapGrid grid_;
};

}  // namespace

std::int64_t Record::index() const { return contents_->record.index; }
std::chrono::nanoseconds Record::start_utc() const { return contents_->record.slot_utc; }
std::chrono::nanoseconds Record::length() const {
  return contents_->record.slot_end - contents_->record.slot_start;
}
const std::string& Record::label() const { return contents_->record.label; }
SensorReport Record::spd() const { return report_of(contents_->record, Sensor::spd); }
SensorReport Record::radar() const { return report_of(contents_->record, Sensor::radar); }
SensorReport Record::camera() const { return report_of(contents_->record, Sensor::depth); }
std::span<const std::uint32_t> Record::counts() const { return contents_->record.spd; }
std::span<const float> Record::power() const { return contents_->record.radar; }
std::span<const float> Record::depth_m() const { return contents_->depth_m; }

Run::Run(const std::string& path)
    : file_(std::make_shared<File>(path,
                                   std::make_shared<record::RunReader>(record::old_run(path)))) {}

const std::string& Run::path() const { return file_->path; }

RunFacts Run::facts() const {
  record::RunInfo info = file_->reader->info();
  return {std::move(info.uuid),   std::move(info.started_utc), std::move(info.ended_utc),
          std::move(info.status), std::move(info.notes),       info.window_s,
          std::move(info.meta)};
}

std::int64_t Run::count() const { return file_->reader->count(); }

std::optional<RunAxis> Run::axis(const std::string& name) const {
  const std::optional<Axis> found = file_->reader->axis(name);
  return found ? std::optional(public_axis(*found)) : std::nullopt;
}

std::size_t Run::zones() const { return file_->reader->axis("spd").value_or(Axis{}).zones.size(); }

MapGrid Run::grid() const { return public_grid(record::map_grid_of(file_->reader->axes())); }

Record Run::read(std::int64_t index) const {
  // Reads the record before its axes, because the next record of a run in progress may add an axis.
  const record::FusedRecord record = file_->reader->read(index);
  return Converter(*file_->reader)(record);
}

void Run::for_each(const std::function<bool(const Record&)>& visit, std::int64_t first,
                   const OnDamaged& on_damaged) const {
  std::optional<Converter> convert;
  file_->reader->for_each(
      [&](const record::FusedRecord& record) {
        if (!convert) convert.emplace(*file_->reader);
        return visit((*convert)(record));
      },
      first, on_damaged);
}

void follow(const std::string& path, const std::function<bool(const Run&, const Record&)>& visit,
            std::int64_t first, const std::function<bool()>& go_on, const OnDamaged& on_damaged) {
  bool wanted = true;
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
          wanted = visit(run, record) && (!go_on || go_on());
          return wanted;
        },
        first, on_damaged ? OnDamaged(skip) : OnDamaged());
    return first != before;
  };
  record::follow(record::old_run(path), take, [&] { return wanted && (!go_on || go_on()); });
}

}  // namespace echofuse

// SPDX-License-Identifier: MIT
#include "sim/dataset/generator.hpp"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <future>
#include <utility>

#include "acquire/measurement/depth_map.hpp"
#include "acquire/record/run_reader.hpp"
#include "acquire/record/run_writer.hpp"
#include "acquire/record/uuid.hpp"
#include "acquire/record/written_run.hpp"
#include "drivers/core/crc32c.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/new_file.hpp"
#include "drivers/util/program.hpp"
#include "sim/scene/room.hpp"
#include "sim/scene/scene_list.hpp"
#include "sim/sensors/depth_camera.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/sensors/radar_echo.hpp"
#include "sim/sensors/zone_fields.hpp"
#include "sim/twin/twin.hpp"

namespace echofuse::sim {
namespace {

constexpr std::int64_t batch_records = 128;

// Independent random streams derived from the seed of a plan.
enum class SeedStream : std::uint64_t {
  scenes,
  order,
  noise,
  antennas = 4,
  room,
  array,
  depth = 8
};
std::uint64_t seed_of(const Plan& plan, SeedStream stream) {
  return mix(static_cast<std::uint64_t>(plan.seed) + mix(static_cast<std::uint64_t>(stream)));
}

Rng rng_of(const Plan& plan, SeedStream stream, std::int64_t index) {
  return make_rng(seed_of(plan, stream), static_cast<std::uint64_t>(index));
}

record::FusedRecord blank_record(std::int64_t index, std::string label, double window_s) {
  record::FusedRecord r;
  r.index = index;
  r.slot_start = from_seconds(static_cast<double>(index) * window_s);
  r.slot_end = from_seconds(static_cast<double>(index + 1) * window_s);
  r.slot_utc = r.slot_start;
  r.label = std::move(label);
  for (const auto sensor : all_sensors) {
    r.accept(sensor);
    r.sync[sensor].used = 1;
  }
  return r;
}

void count_clicks(record::FusedRecord& r, std::int64_t pulses) {
  std::uint64_t clicks = 0;
  for (const auto n : r.spd) clicks += n;
  r.spd_counts.in_range = clicks;
  // 0 at low flux, because pulses are then not simulated
  r.spd_counts.starts = static_cast<std::uint64_t>(pulses);
  r.spd_counts.tags = clicks + r.spd_counts.starts;
  if (pulses > 0)
    r.signal.clicks_per_pulse = static_cast<double>(clicks) / static_cast<double>(pulses);
  r.sync[Sensor::spd].used = clicks;
}

// Simulates records first to last - 1 in parallel. The result does not depend on the number of
// threads.
std::vector<record::FusedRecord> make_batch(const Generator& generator, std::int64_t first,
                                            std::int64_t last, int threads) {
  std::vector<record::FusedRecord> batch(static_cast<std::size_t>(last - first));
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i = next++; i < batch.size(); i = next++)
      batch[i] = generator.make(first + static_cast<std::int64_t>(i));
  };
  std::vector<std::future<void>> workers;
  workers.reserve(static_cast<std::size_t>(threads));
  for (int t = 0; t < threads; ++t) workers.push_back(std::async(std::launch::async, work));
  for (auto& worker : workers) worker.get();
  return batch;
}

std::string one_line(std::string lines) {
  std::string out;
  for (const char c : lines)
    if (c == '\n')
      out += ", ";
    else if (c != ' ')
      out += c;
  return out.substr(0, out.size() - std::min<std::size_t>(2, out.size()));
}

// Returns the instrument response to be stored in the run file; empty if the radar responses of the
// laboratories differ. Omits the IRF width if there are several laboratories.
std::optional<record::Response> stated_response(const Plan& plan) {
  const auto all = laboratories_of(plan);
  record::Response out = stated_response(all.front());
  for (const Conditions& c : all)
    if (!(stated_response(c).radar == out.radar)) return std::nullopt;
  if (all.size() > 1) out.irf_fwhm_ps = {};
  return out;
}

record::RunInfo run_info(const Plan& plan, const DatasetOptions& options) {
  Plan copy = plan;
  Settings settings;
  bind(settings, copy);
  record::RunInfo info;
  info.started_utc = iso8601(system_clock.utc());
  info.config_text = options.config_text;
  info.config_resolved = settings.resolved();
  info.version = version();
  info.host = machine_name();
  info.notes = "simulated data set";
  if (!plan.twin.empty() && plan.laboratories > 0)
    info.notes += " of " + std::to_string(plan.laboratories) + " virtual laboratories",
        info.meta.emplace_back("laboratories", std::to_string(plan.laboratories));
  else if (!plan.twin.empty())
    info.notes += " of virtual laboratory " + std::to_string(plan.laboratory) + ": " +
                  one_line(draws_of(twin_named(plan.twin), plan.laboratory));
  if (const auto detector = stated_detector(plan.conditions); detector.known())
    info.meta.push_back(detector.meta());
  if (const auto stated = stated_response(plan))
    for (const auto& pair : stated->meta()) info.meta.push_back(pair);
  for (const auto& pair : record::RadarMounting{plan.conditions.baseline_m}.meta())
    info.meta.push_back(pair);
  info.window_s = plan.conditions.window_s;
  return info;
}

// Returns the contents of the files named in the settings: the scene list and the mesh.
std::string files_of(const Plan& plan) {
  std::string out;
  for (const std::string& path : {plan.scenes, plan.conditions.object})
    if (!path.empty()) out += read_config_text(path);
  return out;
}

// Returns the UUID (RFC 9562 version 8) of a part of a data set. It consists of the 64-bit FNV-1a
// hash, the CRC-32C and the length of a string. This string contains the version, the settings, the
// part and the contents of the named files.
std::string part_uuid(const record::RunInfo& info, const JobPart& part, const std::string& files) {
  const std::string text =
      info.version + "\n" + info.config_resolved + "\n" + part.name() + "\n" + files;
  std::uint64_t mixed = 0xcbf29ce484222325;
  for (const char c : text) mixed = (mixed ^ static_cast<std::uint8_t>(c)) * 0x100000001b3;
  return record::uuid_text(
      {static_cast<std::uint32_t>(mixed >> 32), static_cast<std::uint32_t>(mixed),
       crc32c({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}),
       static_cast<std::uint32_t>(text.size())},
      8);
}

// Returns true if the file is already the complete run of this part, for example because a job was
// queued twice.
bool is_there(const std::string& path, const record::RunInfo& info, JobPart::IndexRange records) {
  if (!std::filesystem::exists(path)) return false;
  const record::RunReader run(path);
  const record::RunInfo found = run.info();
  return found.uuid == info.uuid && found.status == "complete" && run.count() == records.size();
}

void check_object(const std::vector<SceneSpec>& scenes, const Conditions& conditions) {
  if (conditions.object.empty() &&
      std::find_if(scenes.begin(), scenes.end(),
                   [](const SceneSpec& s) { return s.kind == SceneKind::object; }) != scenes.end())
    throw Error(ExitCode::config, "object scenes need a mesh; set object = \"FILE.obj\"");
}

}  // namespace

std::vector<SceneSpec> scenes_of(const Plan& plan) {
  std::vector<SceneSpec> scenes;
  const auto add = [&](std::int64_t count, SceneKind kind) {
    scenes.insert(scenes.end(), static_cast<std::size_t>(count), kind);
  };
  if (!plan.scenes.empty()) {
    scenes = read_scene_list(read_config_text(plan.scenes), plan.scenes);
    check_object(scenes, plan.conditions);
    return scenes;
  }
  add(plan.people, SceneKind::person);
  add(plan.letters, SceneKind::letter);
  add(plan.two_people, SceneKind::two_people);
  add(plan.empty, SceneKind::empty);
  add(plan.objects, SceneKind::object);
  check_object(scenes, plan.conditions);
  Rng rng = make_rng(seed_of(plan, SeedStream::order), 0);
  for (std::size_t i = scenes.size(); i > 1; --i) std::swap(scenes[i - 1], scenes[rng() % i]);
  return scenes;
}

RoomAlone room_alone(const Conditions& conditions, const AntennaRadar& radar) {
  Conditions c = conditions;
  c.background_counts = 0;
  c.radar_leakage = 0;
  const Scene scene = empty_room(*room_named(c.background));
  RoomAlone room;
  room.light = zone_rates(spd_returns(scene, c), c);
  if (c.radar_sum != "coherent")
    room.power = radar_power(radar_returns(scene, c), radar.axis);
  else if (!radar.antennas.empty())
    room.echo = room_echo(radar, c);
  return room;
}

void add_room(const std::vector<double>& room, std::vector<double>& all) {
  std::transform(room.begin(), room.end(), all.begin(), all.begin(),
                 [](double a, double b) { return std::max(0.0, a + b); });
}

Generator::Generator(Plan plan)
    : plan_(std::move(plan)),
      laboratories_(laboratories_of(plan_)),
      scenes_(scenes_of(plan_)),
      mean_peak_(mean_peak_power(radar_response(plan_.conditions), plan_.conditions)),
      antennas_(simulated_antennas(conditions(0), seed_of(plan_, SeedStream::antennas))) {
  keeps_array_ = !antennas_.empty();
  if (antennas_.empty()) antennas_ = antennas_in_layout(1);
  if (laboratories_.size() == 1 && plan_.conditions.background != "none")
    room_ = room_alone(conditions(0), radar_of(conditions(0)));
}

AntennaRadar Generator::radar_of(const Conditions& c) const {
  return {radar_response(c), antennas_, seed_of(plan_, SeedStream::room)};
}

Scene Generator::scene(std::int64_t index) const {
  const auto i = static_cast<std::size_t>(index);
  return make_scene(conditions(index), scenes_.at(i), seed_of(plan_, SeedStream::scenes), i);
}

record::FusedRecord Generator::make(std::int64_t index) const {
  const Conditions& c = conditions(index);
  const Scene world = scene(index);
  Rng rng = rng_of(plan_, SeedStream::noise, index);
  Rng depth_rng = rng_of(plan_, SeedStream::depth, index);
  record::FusedRecord r = blank_record(index, world.label, c.window_s);
  r.spd = count_photons(world, c, rng);
  count_clicks(r, c.pulses_per_window);
  const auto power = radar_profile(index, world, r, rng);
  r.radar.resize(power.size());
  std::transform(power.begin(), power.end(), r.radar.begin(),
                 [](double p) { return static_cast<float>(p); });
  r.depth_mm = depth_map_mm(world, map_grid(plan_.conditions), c, depth_rng);
  return r;
}

std::vector<std::uint32_t> Generator::count_photons(const Scene& scene, const Conditions& c,
                                                    Rng& rng) const {
  const RoomAlone* room = room_behind(scene);
  thread_local Returns returns;
  spd_returns(scene, c, returns, room ? RoomReturns::subtracted : RoomReturns::included);
  auto rate = zone_rates(returns, c);
  if (room) add_room(room->light, rate);
  return draw_zone_counts(rate, c, rng);
}

std::vector<double> Generator::radar_profile(std::int64_t index, const Scene& scene,
                                             record::FusedRecord& r, Rng& rng) const {
  const Conditions& c = conditions(index);
  const bool coherent = c.radar_sum == "coherent";
  AntennaRadar radar = radar_of(c);
  // Incoherent antenna samples need the covariance of all patches, so the room cannot be simulated
  // separately.
  const RoomAlone* room = coherent || !keeps_array_ ? room_behind(scene) : nullptr;
  thread_local Returns returns;
  radar_returns(scene, c, returns, room ? RoomReturns::subtracted : RoomReturns::included);
  if (room) radar.room = room->echo;
  if (coherent || keeps_array_) {
    auto seen = profile_of_antennas(index, returns, radar, r);
    // Subtracts the mean noise power, as recon/data/dataset.cpp subtracts the median power of
    // measured profiles.
    for (double& p : seen) p -= radar_noise_power(c, mean_peak_);
    if (coherent) return seen;
  }
  auto power = radar_power(returns, radar.axis);
  if (room) add_room(room->power, power);
  add_profile_noise(power, mean_peak_, c, c.radar_frames, rng);
  return power;
}

// Simulates the antenna samples, stores their statistics in the record, and returns the mean power
// at each range point. Uses a separate random stream, so that the number of antennas does not
// affect the photon counts or the depth map.
std::vector<double> Generator::profile_of_antennas(std::int64_t index, const Returns& returns,
                                                   const AntennaRadar& radar,
                                                   record::FusedRecord& r) const {
  const Conditions& c = conditions(index);
  Rng rng = rng_of(plan_, SeedStream::array, index);
  const auto kept = record::array_axis(radar_axis(c), antennas_.size()).count;
  AntennaRecord seen =
      antenna_record(returns, radar, kept, c, radar_noise_power(c, mean_peak_), rng);
  if (keeps_array_) {
    r.array = std::move(seen.array);
    r.array_frames = static_cast<std::uint64_t>(c.radar_frames);
  }
  return std::move(seen.power);
}

namespace {

// Writes the records in `range` until all are written or the program is interrupted. Returns the
// number of records written.
std::int64_t write_records(const Generator& generator, JobPart::IndexRange range,
                           record::RunWriter& writer, const DatasetOptions& options) {
  Progress progress("records", static_cast<std::size_t>(range.size()), options.quiet);
  const auto start_batch = [&](std::int64_t first) {
    return std::async(std::launch::async, make_batch, std::cref(generator), first,
                      std::min(first + batch_records, range.end), options.threads);
  };
  // Computes the next batch while the previous one is written.
  auto pending = start_batch(range.begin);
  while (writer.records() < range.size() && !interrupted()) {
    const auto batch = pending.get();
    pending = start_batch(range.begin + writer.records() + static_cast<std::int64_t>(batch.size()));
    writer.append(batch);
    progress.update(static_cast<std::size_t>(writer.records()));
  }
  return writer.records();
}

}  // namespace

std::int64_t write_dataset(const Plan& plan, const DatasetOptions& options) {
  validate(plan.conditions);
  const Generator generator(plan);
  record::RunInfo info = run_info(plan, options);
  JobPart::IndexRange range{0, generator.records()};
  if (options.part) {
    range = options.part->range(generator.records());
    info.uuid = part_uuid(info, *options.part, files_of(plan));
    if (is_there(options.out, info, range)) return range.size();
  }
  if (std::filesystem::exists(options.out))
    throw Error(ExitCode::failed,
                options.out + (options.part ? ": exists already and is not this part of the data "
                                              "set; choose another --out"
                                            : ": exists already; runs are never overwritten; "
                                              "choose another name"));
  NewFile staged(options.out, NewFile::Staged{});
  record::RunWriter writer(staged.path(), info);
  Axis spd = spd_axis(plan.conditions);
  spd.zones = zones_of(plan.conditions);
  writer.put_axis(spd);
  writer.put_axis(radar_axis(plan.conditions));
  for (const Axis& axis : map_grid(plan.conditions).run_axes()) writer.put_axis(axis);
  if (const auto antennas = generator.stated_antennas(); !antennas.empty()) {
    writer.put_axis(record::array_axis(radar_axis(plan.conditions), antennas.size()));
    writer.put_antennas(antennas);
  }
  const std::int64_t written = write_records(generator, range, writer, options);
  const bool whole = written == range.size();
  writer.close_as_one_file(whole ? "complete" : "stopped:interrupted");
  record::check_written_run(staged.path(), options.out);
  // An interrupted data set is kept, but not an interrupted part, because it would be incomplete.
  if (whole || !options.part) staged.publish();
  return written;
}

}  // namespace echofuse::sim

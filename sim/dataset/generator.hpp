// SPDX-License-Identifier: MIT
// Writes a run file of simulated records. Equal plans give equal bytes on any number of threads,
// except for UUID and time of day.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquire/record/fused_record.hpp"
#include "drivers/util/job_part.hpp"
#include "sim/scene/conditions.hpp"
#include "sim/scene/scene.hpp"
#include "sim/sensors/antennas.hpp"

namespace echofuse::sim {

// Plan of a data set; the run stores it as config_resolved.
struct Plan {
  std::int64_t seed = 1;
  std::int64_t people = 1000, letters = 3000, two_people = 0, empty = 0;  // as in the paper
  std::int64_t objects = 0;
  std::string scenes;     // scene list (sim/scene/scene_list.hpp); replaces the record counts
  Conditions conditions;  // nominal conditions
  // `twin` holds the ranges of what laboratories differ in (twin_named), or is empty. Either all
  // records come from one laboratory, or record i comes from laboratory i mod `laboratories`.
  std::string twin;
  std::int64_t laboratory = 0, laboratories = 0;
};

void bind(Settings& settings, Plan& plan);
// Replaces the twin by the text of its ranges, without keys that are given. Call after reading.
// Throws Error(config) for a twin that cannot be read and for laboratories without a twin.
void resolve_twin(const Settings& settings, Plan& plan);
// Returns the conditions of the plan's laboratories; without a twin there is only one.
std::vector<Conditions> laboratories_of(const Plan& plan);

// Returns the scenes of all records: those of the list in its order, or the numbers of each kind in
// a (seeded) random order. Throws Error(config) for a list that cannot be read and for objects
// without a mesh.
std::vector<SceneSpec> scenes_of(const Plan& plan);

// Returns and echoes of the room alone. The room stands still: in a scene before it, only the part
// that people and objects change has to be looked at (RoomReturns::subtracted).
struct RoomAlone {
  std::vector<double> light;  // spd_rate, without background counts
  std::vector<double> power;  // radar_power, if incoherent
  // Result of room_echo() with coherent antennas; else empty.
  std::vector<std::complex<float>> echo;
};
RoomAlone room_alone(const Conditions& conditions, const AntennaRadar& radar);
// The sum is nowhere below 0.
void add_room(const std::vector<double>& room, std::vector<double>& all);

// Makes any record of a plan by itself. Threading: make() may be called from many threads.
class Generator {
 public:
  explicit Generator(Plan plan);
  std::int64_t records() const { return static_cast<std::int64_t>(scenes_.size()); }
  Scene scene(std::int64_t index) const;
  record::FusedRecord make(std::int64_t index) const;
  record::Antennas stated_antennas() const {
    return keeps_array_ ? sim::stated_antennas(antennas_, plan_.conditions) : record::Antennas{};
  }

 private:
  std::vector<std::uint32_t> count_photons(const Scene& scene, const Conditions& c, Rng& rng) const;
  std::vector<double> radar_profile(std::int64_t index, const Scene& scene, record::FusedRecord& r,
                                    Rng& rng) const;
  std::vector<double> profile_of_antennas(std::int64_t index, const Returns& returns,
                                          const AntennaRadar& radar, record::FusedRecord& r) const;
  AntennaRadar radar_of(const Conditions& c) const;
  const RoomAlone* room_behind(const Scene& scene) const {
    return room_ && scene.room ? &*room_ : nullptr;
  }

  const Conditions& conditions(std::int64_t index) const {
    return laboratories_[static_cast<std::size_t>(index) % laboratories_.size()];
  }

  Plan plan_;
  std::vector<Conditions> laboratories_;
  std::vector<SceneSpec> scenes_;
  double mean_peak_ = 0;
  record::Antennas antennas_;  // includes their errors; one antenna, if their samples are not kept
  bool keeps_array_ = false;
  std::optional<RoomAlone> room_;  // set if all records stand before it, in one laboratory
};

struct DatasetOptions {
  std::string out;
  std::string config_text;  // kept verbatim in the run
  int threads = 2;
  bool quiet = false;
  std::optional<JobPart> part = {};  // if set, only its records
};

// Writes the run file, and returns the number of records written (fewer if interrupted). A part is
// there only when it is whole, and one that is there already is left as it is.
std::int64_t write_dataset(const Plan& plan, const DatasetOptions& options);

}  // namespace echofuse::sim

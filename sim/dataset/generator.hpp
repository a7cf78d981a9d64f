// SPDX-License-Identifier: MIT
// Writes a run file of simulated records. Equal plans give identical files on any number of
// threads, except for the UUID and the start time.
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

// Settings of a simulated data set. The run file stores them as config_resolved.
struct Plan {
  std::int64_t seed = 1;
  // Number of records of each kind. The defaults are those of Lai et al., COL 22(2) 022701 (2024).
  std::int64_t people = 1000, letters = 3000, two_people = 0, empty = 0;
  std::int64_t objects = 0;
  std::string scenes;     // scene list file (sim/scene/scene_list.hpp); replaces the record counts
  Conditions conditions;  // nominal conditions, which a twin varies
  // `twin` contains the ranges from which the settings of laboratories are sampled (twin_named);
  // empty: no twin. If `laboratories` is 0, all records come from laboratory number `laboratory`.
  // Otherwise record i comes from laboratory i mod `laboratories`.
  std::string twin;
  std::int64_t laboratory = 0, laboratories = 0;
};

void bind(Settings& settings, Plan& plan);
// Replaces plan.twin with the TOML text of its ranges, without the keys that are set in the
// settings. Call this function after all settings have been read. Throws Error(config) if the twin
// cannot be read, or if a laboratory is selected without a twin.
void resolve_twin(const Settings& settings, Plan& plan);
// Returns the conditions of each laboratory of the plan; one element if plan.laboratories is 0.
std::vector<Conditions> laboratories_of(const Plan& plan);

// Returns the scene of each record, in the order of the scene list. If the plan has no list, the
// order is random and depends on the seed. Throws Error(config) if the list cannot be read, or if
// an object scene has no mesh.
std::vector<SceneSpec> scenes_of(const Plan& plan);

// Signals from the empty room, computed once because the room is static. A scene in front of the
// room needs only the change caused by people and objects (RoomReturns::subtracted).
struct RoomAlone {
  std::vector<double> light;  // expected number of detections per bin, without background counts
  std::vector<double> power;  // result of radar_power(); empty if echoes are coherent
  // result of room_echo(); empty if echoes are incoherent
  std::vector<std::complex<float>> echo;
};
RoomAlone room_alone(const Conditions& conditions, const AntennaRadar& radar);
// Adds the values of the empty room to `all`, element by element, and sets negative sums to 0.
void add_room(const std::vector<double>& room, std::vector<double>& all);

// Simulates the records of a plan one by one, in any order. Threading: several threads may call
// make() at the same time.
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
  // Antennas with their simulated errors; one antenna if the run file stores no antenna data.
  record::Antennas antennas_;
  bool keeps_array_ = false;
  // Set if the plan has one laboratory and that laboratory has a room.
  std::optional<RoomAlone> room_;
};

struct DatasetOptions {
  std::string out;
  std::string config_text;  // text of the settings file, stored verbatim in the run file
  int threads = 2;
  bool quiet = false;
  std::optional<JobPart> part = {};  // if set, only the records of this part are written
};

// Writes the run file. Returns the number of records written, which is smaller than requested after
// an interrupt. The file of a part becomes visible only when it is complete. If the complete file
// already exists, nothing is written.
std::int64_t write_dataset(const Plan& plan, const DatasetOptions& options);

}  // namespace echofuse::sim

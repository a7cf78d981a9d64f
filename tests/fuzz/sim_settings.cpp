// SPDX-License-Identifier: MIT
// Input: a byte for the kind of file, then the file. The kind is 's' for a list of scenes, 'f' for
// a schedule of faults, 't' for a twin, '=' for a key=value assignment of the command line, and any
// other byte for the simulator's settings.
#include <cmath>

#include "drivers/util/settings.hpp"
#include "fuzz.hpp"
#include "sim/dataset/generator.hpp"
#include "sim/devices/faults.hpp"
#include "sim/scene/scene_list.hpp"
#include "sim/twin/twin.hpp"

namespace {

void read_scenes(const std::string& text) {
  for (const sim::SceneSpec& scene : sim::read_scene_list(text, "x.toml"))
    for (const auto& number : {scene.x_m, scene.z_m, scene.yaw_deg})
      require(!number || std::isfinite(*number), "a place is finite");
}

void read_faults(const std::string& text) {
  const auto all = sim::read_faults(text, "x.toml");
  for (const char* device : {"tdc", "radar", "depth"}) {
    const sim::Faults faults(all, device);
    for (const double time : {0.0, 0.5, 1e3, 1e6})
      require(std::isfinite(faults.clock_error_s(time)), "a clock error is finite");
  }
}

void read_a_twin(const std::string& text) {
  const sim::Twin twin = sim::read_twin(text, "x.toml");
  const std::string written = to_text(twin);
  require(to_text(sim::read_twin(written, "written")) == written, "a twin reads back unchanged");
  for (const std::int64_t laboratory : {0, 7}) sim::conditions_of(twin, laboratory, {});
}

void read_settings(const std::string& text, bool assignment) {
  sim::Plan plan;
  Settings settings;
  bind(settings, plan);
  if (assignment)
    settings.set(text);
  else
    settings.read_text(text, "x.toml");
  const std::string resolved = settings.resolved(true);
  const std::string shown = settings.with_origins();
  // An error here ends the target, because resolved settings must be readable.
  for (const std::string& written : {resolved, shown}) {
    sim::Plan other;
    Settings again;
    bind(again, other);
    again.read_text(written, "resolved");
    require(again.resolved(true) == resolved, "settings read back unchanged");
  }
}

}  // namespace

void fuzz::run(ByteView input) {
  if (input.empty()) return;
  const std::string text(text_of(input.subspan(1)));
  const bool assignment = input[0] == '=';
  faults_by(assignment ? "--set " : "x.toml:", [&] {
    if (input[0] == 's') return read_scenes(text);
    if (input[0] == 'f') return read_faults(text);
    if (input[0] == 't') return read_a_twin(text);
    read_settings(text, assignment);
  });
}

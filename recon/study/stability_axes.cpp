// SPDX-License-Identifier: MIT
#include "recon/study/stability_axes.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include "recon/numbers/text.hpp"

namespace echofuse::recon {
namespace {

constexpr bool matched = true, shifted = false;  // trained there as well, or at the base

using Numbers = std::vector<double>;
using Words = std::vector<std::string>;
using ToWorld = std::function<World(double)>;
using Axes = std::vector<StabilityAxis>;

std::string assignment(const std::string& key, double value) {
  return key + "=" + formatted("%.9g", value);
}

double value_of(const BaseCondition& base, const std::string& key) {
  const auto found = base.find(key);
  if (found == base.end())
    throw Error(ExitCode::failed, "the simulator has no number \"" + key + "\"");
  return found->second;
}

// An axis of numbers, one of them the base; `quick` are those of the quick study, beside the base.
StabilityAxis numbers(bool trained_there, const std::string& name, const std::string& title,
                      double base, const Numbers& values, const Numbers& quick,
                      const ToWorld& world) {
  StabilityAxis axis{name, title, trained_there, {}};
  for (const double v : values)
    axis.values.push_back({formatted("%g", v), v == base ? World{} : world(v),
                           v == base || std::find(quick.begin(), quick.end(), v) != quick.end()});
  if (axis.base() == axis.values.size())
    throw Error(ExitCode::failed, formatted("axis %s has no value for the simulator's base: %g",
                                            axis.id().c_str(), base));
  return axis;
}

ToWorld setting(const std::string& key, double factor = 1) {
  return [=](double v) { return World{.set = {assignment(key, v * factor)}}; };
}

// It is of a setting in units of `unit`.
StabilityAxis numbers(const BaseCondition& base, bool trained_there, const std::string& name,
                      const std::string& title, const std::string& key, const Numbers& values,
                      const Numbers& quick, double unit = 1) {
  return numbers(trained_there, name, title, value_of(base, key) / unit, values, quick,
                 setting(key, unit));
}

// Over the same span.
World bin_width(const BaseCondition& base, double ps) {
  const double span_ps = value_of(base, "bin_width_ps") * value_of(base, "bins");
  return {.set = {assignment("bin_width_ps", ps), assignment("bins", std::round(span_ps / ps))}};
}

// Sampled as densely, over the same span.
std::vector<std::string> resolution(const BaseCondition& base, double m) {
  const double base_step = value_of(base, "radar_step_m");
  const double step = m * base_step / value_of(base, "radar_resolution_m");
  const double span_m = base_step * (value_of(base, "radar_bins") - 1);
  return {assignment("radar_resolution_m", m), assignment("radar_step_m", step),
          assignment("radar_bins", std::floor(span_m / step) + 1)};
}

World fine_speckle(const BaseCondition& base) {
  World world{.set = resolution(base, 0.044)};
  world.set.push_back("radar_sum=coherent");
  return world;
}

bool is_coherent(const BaseCondition& base) { return base.contains("radar_sum=coherent"); }

// With both kinds of echoes, one of them the base.
std::vector<AxisValue> speckles(const BaseCondition& base) {
  const bool coherent = is_coherent(base);
  const std::vector<std::string> set = {"radar_sum=coherent"};
  const double cm = 100 * value_of(base, "radar_resolution_m");
  std::vector<AxisValue> out = {
      {"incoherent", coherent ? World{.set = {"radar_sum=incoherent"}} : World{}},
      {formatted("coherent %g cm", cm), coherent ? World{} : World{.set = set}}};
  if (!coherent)
    out.push_back({"coherent 4 carriers", World{.set = {set[0], "radar_carriers=4"}}, false});
  return out;
}

// People who move by this share of what is usual.
World moving(const BaseCondition& base, double share) {
  World out;
  for (const char* key : {"radar_sway_m", "radar_twist_deg", "radar_breath_m"})
    out.set.push_back(assignment(key, share * value_of(base, key)));
  return out;
}

// So many photons to a pulse that the first one hides later ones.
World pile_up(const BaseCondition& base, double photons_a_pulse, bool stated) {
  World out{
      .set = {assignment("pulses_per_window", value_of(base, "signal_photons") / photons_a_pulse)}};
  if (!stated) out.set.push_back("spd_detector_stated=false");
  return out;
}

bool has_array(const BaseCondition& base) { return antennas_of(base) > 1; }

World antennas(double count) { return {.set = {assignment("radar_antennas", count)}}; }

// By how much the antennas' phases differ from what the run says of them.
World unknown_phases(double deg) {
  return {.set = {assignment("radar_phase_error_rad", deg * M_PI / 180),
                  "radar_array_calibrated=false"}};
}

World standing_from(double near_m, double far_m) {
  return {.set = {assignment("target_z_min_m", near_m), assignment("target_z_max_m", far_m)}};
}

// Matched: the sensors.
void add_sensors(Axes& all, const BaseCondition& base) {
  const double photons = value_of(base, "signal_photons");
  const double pulses = value_of(base, "pulses_per_window");
  all.push_back(numbers(base, matched, "irf", "SPD's impulse response, FWHM (ps)", "irf_fwhm_ps",
                        {2, 50, 200, 500, 1000, 2000}, {2, 2000}));
  all.push_back(numbers(matched, "bin_width", "SPD's bin width (ps)",
                        value_of(base, "bin_width_ps"), {10, 50, 100, 200, 400, 800}, {800},
                        [&](double ps) { return bin_width(base, ps); }));
  all.push_back(numbers(matched, "radar_resolution", "radar's resolution (m)",
                        value_of(base, "radar_resolution_m"), {0.044, 0.1, 0.25, 0.5, 1},
                        {0.044, 1}, [&](double m) { return World{.set = resolution(base, m)}; }));
  all.push_back(numbers(base, matched, "baseline", "baseline (m)", "baseline_m",
                        {2, 1, 0.5, 0.2, 0.1, 0}, {2, 0.1, 0}));
  all.push_back(numbers(base, matched, "snr", "radar's SNR (dB)", "radar_snr_db",
                        {30, 20, 10, 5, 0}, {10, 0}));
  all.push_back(numbers(base, matched, "photons", "photons a record", "signal_photons",
                        {1e6, 1e5, 1e4, 1e3, 1e2}, {1e3, 1e2}));
  all.push_back(numbers(base, matched, "background", "SPD's background (counts to a signal photon)",
                        "background_counts", {0, 0.1, 1, 10, 100}, {1, 10}, photons));
  all.push_back(numbers(matched, "pile_up", "pile-up (photons to a laser pulse, the first is seen)",
                        pulses > 0 ? photons / pulses : 0, {0, 0.01, 0.1, 0.5, 1, 2}, {0.1, 2},
                        [&](double v) { return pile_up(base, v, true); }));
  all.push_back({"speckle", "radar's sum of echoes", matched, speckles(base)});
  all.back().values.insert(all.back().values.begin() + 1,
                           {"coherent 4.4 cm", fine_speckle(base), false});
  Numbers counts = {1, 2, 4, 8};
  if (antennas_of(base) > 8) counts.push_back(antennas_of(base));
  all.push_back(numbers(matched, "antennas", "radar's antennas", antennas_of(base), counts,
                        {1, 2, 8}, antennas));
  if (has_array(base) || is_coherent(base))
    all.push_back(numbers(base, matched, "looks", "radar's frames a record", "radar_frames",
                          {15, 60, 240}, {15}));
  if (is_coherent(base))
    all.push_back(numbers(base, matched, "carriers", "radar's carriers", "radar_carriers",
                          {1, 2, 4, 8}, {1, 4}));
}

void add_scenes(Axes& all, const BaseCondition& base) {
  all.push_back(numbers(matched, "records", "training records (factor)", 1,
                        {6.67, 3, 1, 0.28, 0.07}, {0.28},
                        [](double v) { return World{.records = v}; }));
  all.push_back(numbers(base, matched, "size", "size of the body (factor)", "target_scale",
                        {1.5, 1, 0.7, 0.5, 0.3}, {0.5}));
  all.push_back(numbers(base, matched, "side", "bodies within |x| (m)", "target_x_m",
                        {1, 0.5, 0.25, 0.1}, {0.1}));
  all.push_back({"scenes",
                 "scenes",
                 matched,
                 {{"people and letters", {}},
                  {"people", {.scenes = "people"}},
                  {"letters", {.scenes = "letters"}, false},
                  {"two people", {.scenes = "two-people"}}}});
}

// Shifted: an instrument that changed since the training.
void add_shifted_conditions(Axes& all, const BaseCondition& base) {
  const double photons = value_of(base, "signal_photons");
  const Numbers gains = {0.25, 0.5, 1, 2, 4};
  all.push_back(numbers(base, shifted, "spd_delay", "SPD's delay after calibration (ps)",
                        "spd_delay_ps", {0, 10, 50, 100, 200, 500}, {50, 200, 500}));
  all.push_back(numbers(base, shifted, "radar_offset", "radar's offset after calibration (m)",
                        "radar_bias_m", {0, 0.01, 0.02, 0.05, 0.1, 0.2}, {0.02, 0.05, 0.2}));
  all.push_back(numbers(base, shifted, "spd_gain", "light (factor)", "signal_photons", gains,
                        {0.25, 4}, photons));
  all.push_back(numbers(shifted, "radar_gain", "radar's gain (factor)", 1, gains, {0.25, 4},
                        [](double v) { return World{.radar_gain = v}; }));
  all.push_back(numbers(base, shifted, "irf", "SPD's impulse response, FWHM (ps)", "irf_fwhm_ps",
                        {100, 200, 300}, {100, 300}));
  all.push_back(numbers(base, shifted, "snr", "radar's SNR (dB)", "radar_snr_db",
                        {30, 20, 10, 5, 0}, {10, 0}));
  all.push_back(numbers(base, shifted, "baseline", "baseline (m)", "baseline_m",
                        {0.4, 0.45, 0.5, 0.55, 0.6}, {0.4, 0.6}));
  all.push_back(numbers(base, shifted, "background", "SPD's background (counts to a signal photon)",
                        "background_counts", {0, 0.1, 1, 10}, {0.1, 1, 10}, photons));
  if (value_of(base, "pulses_per_window") == 0)
    all.push_back({"pile_up",
                   "pile-up (photons to a laser pulse), corrected or not",
                   shifted,
                   {{"none", {}},
                    {"0.1", pile_up(base, 0.1, true), false},
                    {"0.1 uncorrected", pile_up(base, 0.1, false), false},
                    {"0.5", pile_up(base, 0.5, true), false},
                    {"0.5 uncorrected", pile_up(base, 0.5, false), false},
                    {"2", pile_up(base, 2, true)},
                    {"2 uncorrected", pile_up(base, 2, false)}}});
  all.push_back({"speckle", "radar's sum of echoes", shifted, speckles(base)});
  if (is_coherent(base)) {
    all.push_back(numbers(base, shifted, "carriers", "radar's carriers", "radar_carriers",
                          {1, 2, 4, 8}, {1, 4}));
    all.push_back(numbers(shifted, "motion", "people's motion (factor)", 1, {1, 0.5, 0.2, 0}, {0},
                          [&](double share) { return moving(base, share); }));
  }
  if (!has_array(base)) return;
  all.push_back({"antennas",
                 "radar's antennas",
                 shifted,
                 {{formatted("%g", antennas_of(base)), {}}, {"lost", antennas(1)}}});
  all.push_back(numbers(shifted, "phase", "error of the antennas' phases (degrees, rms)", 0,
                        {0, 5, 15, 30, 60}, {15, 30}, unknown_phases));
}

// Trained in that weather, or in clear air.
void add_weather(Axes& all, const BaseCondition& base) {
  for (const bool there : {matched, shifted}) {
    all.push_back(numbers(base, there, "fog", "visibility in fog (m), 0: clear", "fog_visibility_m",
                          {0, 1000, 300, 100, 50, 20, 10, 5}, {100, 20}));
    all.push_back(numbers(base, there, "smoke", "visibility in smoke (m), 0: clear",
                          "smoke_visibility_m", {0, 100, 20, 10, 5}, {20}));
    all.push_back(
        numbers(base, there, "rain", "rain (mm/h)", "rain_mm_h", {0, 1, 10, 50, 100}, {100}));
  }
}

// A shorter slot has fewer photons and radar frames. Antennas need more frames than there are of
// them. People who walk stand in the training; the true map is that of the slot's middle.
void add_slots(Axes& all, const BaseCondition& base) {
  const double slot_s = value_of(base, "window_s"), frames = value_of(base, "radar_frames");
  Numbers slots = {slot_s};
  for (const double s : {3., 2., 1., 0.5, 0.25, 0.1, 0.05})
    if (s != slot_s && (!has_array(base) || frames * s / slot_s > antennas_of(base)))
      slots.push_back(s);
  std::ranges::sort(slots, std::greater());
  all.push_back(
      numbers(matched, "slot", "length of a record (s)", slot_s, slots, {0.5, 1}, [=](double s) {
        World world{.set = {assignment("window_s", s)}};
        for (const char* key : {"signal_photons", "background_counts"})
          world.set.push_back(assignment(key, value_of(base, key) * s / slot_s));
        world.set.push_back(
            assignment("radar_frames", std::max(1.0, std::round(frames * s / slot_s))));
        return world;
      }));
  all.push_back(numbers(shifted, "walk", "people who walk (m/s)", 0, {0, 0.25, 0.5, 1}, {0.5},
                        [=](double v) { return World{.walks_m = v * slot_s}; }));
}

// People before walls, and with echoes by these. RF and sound: one sensor as in Turpin et al., PRL
// 126, 174301 (2021), whose walls mirror and scatter little; direct: without these echoes. In the
// corridor people stand nearer to the middle.
void add_rooms(Axes& all, const BaseCondition& base) {
  StabilityAxis axis{"rooms", "rooms, and echoes by their walls", matched, {{"open", {}}}};
  const Words echoes{"multipath_order=2"};
  Words direct = resolution(base, 0.044), sound = resolution(base, 0.02);
  direct.push_back("radar_wall_scatter=0.1");
  Words rf = direct;
  rf.insert(rf.end(), echoes.begin(), echoes.end());
  sound.insert(sound.end(),
               {"multipath_order=2", "radar_wall_reflectivity=0.97", "radar_wall_scatter=0.03"});
  const auto add = [&](const std::string& room, const std::string& label, Words set, bool quick) {
    set.push_back("background=" + room);
    if (room != "room" && room != "closed") set.push_back("target_x_m=0.7");
    axis.values.push_back({room + label, World{.set = std::move(set)}, quick});
  };
  add("none", " narrow", {}, false);
  axis.values.back().label = "open narrow";
  add("room", "", {}, false);
  add("room", " echoes", echoes, false);
  for (const char* room : {"corridor", "closed"}) {
    add(room, "", {}, true);
    add(room, " echoes", echoes, true);
    add(room, " RF 4.4 cm direct", direct, false);
    add(room, " RF 4.4 cm", rf, false);
    add(room, " sound 2 cm", sound, false);
  }
  all.push_back(std::move(axis));
}

void add_surprises(Axes& all, const BaseCondition& base) {
  for (const bool radar : {true, false})
    all.push_back({radar ? "lost_radar" : "lost_spd",
                   radar ? "radar" : "SPD",
                   shifted,
                   {{"there", {}},
                    {"zeros", {.damage = radar ? Damage::radar_zero : Damage::spd_zero}},
                    {"missing", {.damage = radar ? Damage::radar_missing : Damage::spd_missing}}}});
  all.push_back({"scenes",
                 "scenes",
                 shifted,
                 {{"people and letters", {}},
                  {"people", {.scenes = "people"}, false},
                  {"letters", {.scenes = "letters"}, false},
                  {"two people", {.scenes = "two-people"}},
                  // Without background the histogram would be zeros, as of a dead sensor.
                  {"nobody", {.set = {"background_counts=10000"}, .scenes = "empty"}}}});
  all.push_back(numbers(shifted, "side", "bodies at |x| (m)", value_of(base, "target_x_m"),
                        {1, 1.1, 1.25, 1.5}, {1.25, 1.5},
                        [](double v) { return World{.at_x_m = v}; }));
  all.back().values.front().label.insert(0, "within ");
  const double near_m = value_of(base, "target_z_min_m"), far_m = value_of(base, "target_z_max_m");
  all.push_back({"distance",
                 "bodies at z (m)",
                 shifted,
                 {{"2.5 to 3", standing_from(2.5, 3), false},
                  {formatted("%g to %g", near_m, far_m), {}},
                  {"4 to 4.5", standing_from(4, 4.5)},
                  {"4.5 to 5", standing_from(4.5, 5), false},
                  {"5 to 6", standing_from(5, 6)}}});
}

void lose(Dataset& data, Sensor sensor, bool missing) {
  Matrix& table = sensor == Sensor::spd ? data.spd : data.radar;
  std::fill(table.values.begin(), table.values.end(), 0.f);
  if (sensor == Sensor::radar) std::fill(data.array.values.begin(), data.array.values.end(), 0.f);
  if (missing)
    for (auto& valid : data.valid) valid &= ~(1u << static_cast<unsigned>(sensor));
}

}  // namespace

// One whose samples are not kept is one.
double antennas_of(const BaseCondition& base) {
  return std::max(value_of(base, "radar_antennas"), 1.0);
}

std::size_t StabilityAxis::base() const {
  return static_cast<std::size_t>(
      std::find_if(values.begin(), values.end(), [](const auto& v) { return v.world.base(); }) -
      values.begin());
}

std::vector<StabilityAxis> stability_axes(const BaseCondition& base, bool quick) {
  Axes all;
  add_sensors(all, base), add_scenes(all, base), add_slots(all, base), add_rooms(all, base);
  add_shifted_conditions(all, base), add_weather(all, base), add_surprises(all, base);
  for (auto& axis : all)
    if (quick) std::erase_if(axis.values, [](const AxisValue& v) { return !v.quick; });
  return all;
}

void apply(const World& world, Dataset& data) {
  for (Matrix* table : {&data.radar, &data.array})
    for (float& power : table->values) power *= static_cast<float>(world.radar_gain);
  if (world.damage == Damage::none) return;
  const bool spd = world.damage == Damage::spd_zero || world.damage == Damage::spd_missing;
  lose(data, spd ? Sensor::spd : Sensor::radar,
       world.damage == Damage::spd_missing || world.damage == Damage::radar_missing);
}

}  // namespace echofuse::recon

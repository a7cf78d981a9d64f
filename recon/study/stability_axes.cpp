// SPDX-License-Identifier: MIT
#include "recon/study/stability_axes.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include "recon/files/text.hpp"

namespace echofuse::recon {
namespace {

constexpr bool matched = true, shifted = false;  // trained there as well, or at the base

using Numbers = std::vector<double>;
using ToWorld = std::function<World(double)>;

std::string assignment(const std::string& key, double value) {
  return key + "=" + formatted("%.9g", value);
}

// An axis of numbers; `quick` are those of the quick study, beside the base.
StabilityAxis numbers(bool trained_there, const std::string& name, const std::string& title,
                      double base, const Numbers& values, const Numbers& quick,
                      const ToWorld& world) {
  StabilityAxis axis{name, title, trained_there, {}};
  for (const double v : values)
    axis.values.push_back({formatted("%g", v), v == base ? World{} : world(v),
                           v == base || std::find(quick.begin(), quick.end(), v) != quick.end()});
  return axis;
}

ToWorld setting(const std::string& key, double factor = 1) {
  return [=](double v) { return World{.set = {assignment(key, v * factor)}}; };
}

constexpr double spd_span_ps = 33600, radar_span_m = 7, photons = 1e5;

World bin_width(double ps) {
  return {
      .set = {assignment("bin_width_ps", ps), assignment("bins", std::round(spd_span_ps / ps))}};
}

std::vector<std::string> resolution(double m) {
  const double step = m / 2;
  return {assignment("radar_resolution_m", m), assignment("radar_step_m", step),
          assignment("radar_bins", std::floor(radar_span_m / step) + 1)};
}

World fine_speckle() {
  World world{.set = resolution(0.044)};
  world.set.push_back("radar_sum=coherent");
  return world;
}

World standing_from(double near_m, double far_m) {
  return {.set = {assignment("target_z_min_m", near_m), assignment("target_z_max_m", far_m)}};
}

// Matched: the sensors.
void add_sensors(std::vector<StabilityAxis>& all) {
  all.push_back(numbers(matched, "irf", "SPD's impulse response, FWHM (ps)", 200,
                        {2, 50, 200, 500, 1000, 2000}, {2, 2000}, setting("irf_fwhm_ps")));
  all.push_back(numbers(matched, "bin_width", "SPD's bin width (ps)", 100,
                        {10, 50, 100, 200, 400, 800}, {800}, bin_width));
  all.push_back(numbers(matched, "radar_resolution", "radar's resolution (m)", 0.5,
                        {0.044, 0.1, 0.25, 0.5, 1}, {0.044, 1},
                        [](double m) { return World{.set = resolution(m)}; }));
  all.push_back(numbers(matched, "baseline", "baseline (m)", 0.5, {2, 1, 0.5, 0.2, 0.1, 0},
                        {2, 0.1, 0}, setting("baseline_m")));
  all.push_back(numbers(matched, "snr", "radar's SNR (dB)", 20, {30, 20, 10, 5, 0}, {10, 0},
                        setting("radar_snr_db")));
  all.push_back(numbers(matched, "photons", "photons a record", photons, {1e6, 1e5, 1e4, 1e3, 1e2},
                        {1e3, 1e2}, setting("signal_photons")));
  all.push_back(numbers(matched, "background", "SPD's background (counts to a signal photon)", 0,
                        {0, 0.1, 1, 10, 100}, {1, 10}, setting("background_counts", photons)));
  all.push_back(numbers(matched, "pile_up", "pile-up (photons to a laser pulse, the first is seen)",
                        0, {0, 0.01, 0.1, 0.5, 1, 2}, {0.1, 2}, [](double v) {
                          return World{.set = {assignment("pulses_per_window", photons / v)}};
                        }));
  all.push_back({"speckle",
                 "radar's sum of echoes",
                 matched,
                 {{"incoherent", {}},
                  {"coherent 4.4 cm", fine_speckle(), false},
                  {"coherent 50 cm", {.set = {"radar_sum=coherent"}}}}});
}

void add_scenes(std::vector<StabilityAxis>& all) {
  all.push_back(numbers(matched, "records", "training records (factor)", 1,
                        {6.67, 3, 1, 0.28, 0.07}, {0.28},
                        [](double v) { return World{.records = v}; }));
  all.push_back(numbers(matched, "size", "size of the body (factor)", 1, {1.5, 1, 0.7, 0.5, 0.3},
                        {0.5}, setting("target_scale")));
  all.push_back(numbers(matched, "side", "bodies within |x| (m)", 1, {1, 0.5, 0.25, 0.1}, {0.1},
                        setting("target_x_m")));
  all.push_back({"scenes",
                 "scenes",
                 matched,
                 {{"people and letters", {}},
                  {"people", {.scenes = "people"}},
                  {"letters", {.scenes = "letters"}, false},
                  {"two people", {.scenes = "two-people"}}}});
}

// Shifted: an instrument that changed since the training.
void add_shifted_conditions(std::vector<StabilityAxis>& all) {
  const Numbers gains = {0.25, 0.5, 1, 2, 4};
  all.push_back(numbers(shifted, "spd_delay", "SPD's delay after calibration (ps)", 0,
                        {0, 10, 50, 100, 200, 500}, {50, 200, 500}, setting("spd_delay_ps")));
  all.push_back(numbers(shifted, "radar_offset", "radar's offset after calibration (m)", 0,
                        {0, 0.01, 0.02, 0.05, 0.1, 0.2}, {0.02, 0.05, 0.2},
                        setting("radar_bias_m")));
  all.push_back(numbers(shifted, "spd_gain", "light (factor)", 1, gains, {0.25, 4},
                        setting("signal_photons", photons)));
  all.push_back(numbers(shifted, "radar_gain", "radar's gain (factor)", 1, gains, {0.25, 4},
                        [](double v) { return World{.radar_gain = v}; }));
  all.push_back(numbers(shifted, "irf", "SPD's impulse response, FWHM (ps)", 200, {100, 200, 300},
                        {100, 300}, setting("irf_fwhm_ps")));
  all.push_back(numbers(shifted, "snr", "radar's SNR (dB)", 20, {30, 20, 10, 5, 0}, {10, 0},
                        setting("radar_snr_db")));
  all.push_back(numbers(shifted, "baseline", "baseline (m)", 0.5, {0.4, 0.45, 0.5, 0.55, 0.6},
                        {0.4, 0.6}, setting("baseline_m")));
  all.push_back(numbers(shifted, "background", "SPD's background (counts to a signal photon)", 0,
                        {0, 0.1, 1, 10}, {0.1, 1, 10}, setting("background_counts", photons)));
  all.push_back({"speckle",
                 "radar's sum of echoes",
                 shifted,
                 {{"incoherent", {}}, {"coherent 50 cm", {.set = {"radar_sum=coherent"}}}}});
}

void add_surprises(std::vector<StabilityAxis>& all) {
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
  all.push_back(numbers(shifted, "side", "bodies at |x| (m)", 1, {1, 1.1, 1.25, 1.5}, {1.25, 1.5},
                        [](double v) { return World{.at_x_m = v}; }));
  all.back().values.front().label = "within 1";
  all.push_back({"distance",
                 "bodies at z (m)",
                 shifted,
                 {{"2.5 to 3", standing_from(2.5, 3), false},
                  {"3 to 4", {}},
                  {"4 to 4.5", standing_from(4, 4.5)},
                  {"4.5 to 5", standing_from(4.5, 5), false},
                  {"5 to 6", standing_from(5, 6)}}});
}

void lose(Dataset& data, Sensor sensor, bool missing) {
  Matrix& table = sensor == Sensor::spd ? data.spd : data.radar;
  std::fill(table.values.begin(), table.values.end(), 0.f);
  if (missing)
    for (auto& valid : data.valid) valid &= ~(1u << static_cast<unsigned>(sensor));
}

}  // namespace

std::size_t StabilityAxis::base() const {
  return static_cast<std::size_t>(
      std::find_if(values.begin(), values.end(), [](const auto& v) { return v.world.base(); }) -
      values.begin());
}

std::vector<StabilityAxis> stability_axes(bool quick) {
  std::vector<StabilityAxis> all;
  add_sensors(all), add_scenes(all), add_shifted_conditions(all), add_surprises(all);
  for (auto& axis : all)
    if (quick) std::erase_if(axis.values, [](const AxisValue& v) { return !v.quick; });
  return all;
}

void apply(const World& world, Dataset& data) {
  for (float& power : data.radar.values) power *= static_cast<float>(world.radar_gain);
  if (world.damage == Damage::none) return;
  const bool spd = world.damage == Damage::spd_zero || world.damage == Damage::spd_missing;
  lose(data, spd ? Sensor::spd : Sensor::radar,
       world.damage == Damage::spd_missing || world.damage == Damage::radar_missing);
}

}  // namespace echofuse::recon

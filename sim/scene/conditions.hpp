// SPDX-License-Identifier: MIT
// Settings of the simulation with their default values (the base condition). bind() in
// conditions.cpp contains the description and range of each setting, which `echofuse-sim config`
// prints. The SPD and the depth camera are at the origin and look along +z. x points to the right,
// and y points up. The radar is at (-baseline_m, 0, 0).
#pragma once
#include <cstdint>
#include <string>

#include "acquire/measurement/depth_map.hpp"
#include "acquire/measurement/response.hpp"
#include "drivers/core/axis.hpp"
#include "drivers/util/settings.hpp"
#include "sim/scene/radar_axis.hpp"

namespace echofuse::sim {

struct Conditions {
  // Geometry and scenes. The default of `window_s` is the value used by Lai et al., COL 22(2)
  // 022701 (2024).
  double window_s = 3, baseline_m = 0.5, half_tangent = 0.55, camera_height_m = 1.1;
  double target_x_m = 1.0, target_z_min_m = 3.0, target_z_max_m = 4.0, target_scale = 1.0;
  double person_yaw_deg = 60, letter_yaw_deg = 30;
  std::string background = "none";
  std::string reflector_before = "detector";
  double reflector_z_m = 1;
  std::int64_t multipath_order = 0;
  std::string object{}, object_up = "y";
  double object_scale = 1;

  // People (sim/scene/person.hpp).
  double height_min_m = 1.55, height_max_m = 1.90;
  double girth = 1, shoulder_width = 1, limb_width = 1, leg_length = 1, body_spread = 0;
  double pose_spread = 1;
  double albedo_min = 0.3, albedo_max = 0.7, albedo_contrast = 0;

  // Letters. By default a letter is 0.33 to 0.37 body heights in front of the chest. Its centre is
  // between 0.12 body heights below the shoulders and 0.02 body heights above them.
  double letter_albedo = 0.8, letter_scale = 1, letter_reach = 1, letter_lift_m = 0;
  double letter_tilt_deg = 0;

  // Reflectivity. A lobe with exponent n = 2 alpha is the directive model of diffuse scattering
  // (Degli-Esposti et al., IEEE TAP 55, 143, 2007). In the backward direction, the factor ((1 + cos
  // psi)/2)^alpha equals cos^(2 alpha) of the angle of incidence. The normalisation keeps the echo
  // of a sphere constant.
  double radar_cloth = 1, radar_skin = 1, radar_plate = 1, radar_follows_albedo = 1;
  double radar_lobe = 1, radar_plate_lobe = 1, optical_lobe = 1;

  // Single-photon detector (SPD).
  std::int64_t spd_rays = 0, spd_zones = 1;
  double irf_fwhm_ps = 200, irf_tail_ps = 0, irf_tail_share = 1;
  double bin_width_ps = 100, first_bin_ps = 13343;
  std::int64_t bins = 336;
  double signal_photons = 1e5, background_counts = 0, spd_delay_ps = 0;
  std::int64_t pulses_per_window = 0;
  double spd_dead_time_ps = 0;
  bool spd_detector_stated = true;
  // The signal at tangent t from the axis of the detector is multiplied by exp(-spd_falloff (t /
  // (half_tangent spd_field))^2).
  double spd_falloff = 0, spd_field = 1, spd_yaw_deg = 0;
  double slot_sway_m = 0;

  // Radar. In the vertical direction, `radar_rays` / 2 rays cover the tangents up to
  // `radar_half_tangent` / 2.
  std::int64_t radar_rays = 288;
  double radar_resolution_m = 0.5, radar_step_m = 0.25;
  std::int64_t radar_bins = 29;
  double radar_snr_db = 20, radar_bias_m = 0;
  std::string radar_psf = "sinc", radar_taps{}, radar_sum = "incoherent";
  double radar_taper = 0, radar_leakage = 0;
  // Power reflectivity of concrete at normal incidence, for a permittivity of 5.24 at 60 GHz (ITU-R
  // P.2040-3). For sound, plaster reflects 0.97 of the power.
  double radar_wall_reflectivity = 0.15, radar_wall_scatter = 1;
  double baseline_error_m = 0, radar_falloff = 0, radar_yaw_deg = 0, radar_psf_width = 1;

  // Radar antennas (sim/sensors/antennas.hpp) and body motion.
  std::int64_t radar_antennas = 0, radar_frames = 60;
  double radar_phase_error_rad = 0, radar_gain_error_db = 0;
  bool radar_array_calibrated = true;
  double radar_sway_m = 0.005, radar_twist_deg = 0.3, radar_breath_m = 0.004;

  // Depth camera and depth maps.
  std::int64_t map_size = 64;
  double map_half_tangent = 0, map_z_max_m = 6;
  double depth_noise_m = 0, depth_dropout = 0, depth_offset_m = 0;

  // Returns true if the detector sends histograms; a detector of one pixel sends time tags.
  bool sends_histograms() const { return spd_zones > 1; }
};

// Tangent of half the radar's field of view, which corresponds to a beam of +-50 degrees.
inline constexpr double radar_half_tangent = 1.2;
inline constexpr double radar_carrier_hz = 60.25e9;

// Binds each member to the setting with the same name. Call validate() after the settings have been
// read.
void bind(Settings& settings, Conditions& conditions);
// Throws Error(config) if settings contradict each other, or if the mesh of an object cannot be
// read.
void validate(const Conditions& conditions);
// Returns the name, the size and the number of triangles of the object's mesh. Throws Error(config)
// if the mesh is larger than the room, smaller than a pixel or has too many triangles.
std::string object_text(const Conditions& c);

// Returns the number of detector rays across the field of view: `spd_rays` or, if that is 0, a
// number that depends on `signal_photons`. This number keeps the variance of the sampling error
// below a tenth of the shot-noise variance. With 256 rays and 1e5 photons the ratio of these
// variances is 0.29 per bin (recon/python/examples/detail.py). The ratio is proportional to
// rays^-3.65 and to the number of photons. With a margin of 25 % this gives
//   rays = 256 (3.6 signal_photons / 1e5)^(1/3.65),
// rounded up to an even number and clipped to the range from 64 to 2048.
std::int64_t rays_of(const Conditions& conditions);

Axis spd_axis(const Conditions& conditions);
record::MapGrid map_grid(const Conditions& conditions);
Axis radar_axis(const Conditions& conditions);
RadarAxis radar_response(const Conditions& conditions);
// Returns the instrument response to be stored in the run file: nominal values, without
// `radar_psf_width`.
record::Response stated_response(const Conditions& conditions);
// Returns the x coordinate of the radar, m, including `baseline_error_m`.
double radar_x_m(const Conditions& conditions);

}  // namespace echofuse::sim

// SPDX-License-Identifier: MIT
// Parameters of the simulation; the initialisers are the base condition. bind() in conditions.cpp
// documents each with its range (printed by `echofuse-sim config`). SPD and depth camera are at the
// origin and look along +z, with x right and y up; the radar is at (-baseline_m, 0, 0).
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
  // Geometry and scenes. window_s as in Lai et al., COL 22(2) 022701 (2024).
  double window_s = 3, baseline_m = 0.5, half_tangent = 0.55, camera_height_m = 1.1;
  double target_x_m = 1.0, target_z_min_m = 3.0, target_z_max_m = 4.0, target_scale = 1.0;
  double person_yaw_deg = 60, letter_yaw_deg = 30;
  std::string background = "none";
  std::string reflector_before = "detector";
  std::int64_t multipath_order = 0;
  std::string object, object_up = "y";
  double object_scale = 1;

  // People (sim/scene/person.hpp).
  double height_min_m = 1.55, height_max_m = 1.90;
  double girth = 1, shoulder_width = 1, limb_width = 1, leg_length = 1, body_spread = 0;
  double pose_spread = 1;
  double albedo_min = 0.3, albedo_max = 0.7, albedo_contrast = 0;

  // Letters. The base distance to the chest is 0.33 to 0.37 body heights; the base height is 0.02
  // above to 0.12 body heights below the shoulders.
  double letter_albedo = 0.8, letter_scale = 1, letter_reach = 1, letter_lift_m = 0;
  double letter_tilt_deg = 0;

  // Reflectivity. A lobe of n = 2 alpha is the directive model of diffuse scattering (Degli-Esposti
  // et al., IEEE TAP 55, 143, 2007): its ((1 + cos psi)/2)^alpha equals cos^(2 alpha) in the
  // backward direction. Normalised so that a sphere's echo stays the same.
  double radar_cloth = 1, radar_skin = 1, radar_plate = 1, radar_follows_albedo = 1;
  double radar_lobe = 1, radar_plate_lobe = 1, optical_lobe = 1;

  // SPD.
  std::int64_t spd_rays = 0, spd_zones = 1;
  double irf_fwhm_ps = 200, irf_tail_ps = 0, irf_tail_share = 1;
  double bin_width_ps = 100, first_bin_ps = 13343;
  std::int64_t bins = 336;
  double signal_photons = 1e5, background_counts = 0, spd_delay_ps = 0;
  std::int64_t pulses_per_window = 0;
  double spd_dead_time_ps = 0;
  bool spd_detector_stated = true;
  // Falloff exp(-falloff t^2 / half_tangent^2) at tangent t from the detector's axis.
  double spd_falloff = 0, spd_field = 1, spd_yaw_deg = 0;
  double slot_sway_m = 0;

  // Radar. The vertical field has half of radar_rays and half the tangent.
  std::int64_t radar_rays = 288;
  double radar_resolution_m = 0.5, radar_step_m = 0.25;
  std::int64_t radar_bins = 29;
  double radar_snr_db = 20, radar_bias_m = 0;
  std::string radar_psf = "sinc", radar_taps, radar_flanks, radar_sum = "incoherent";
  double radar_taper = 0, radar_leakage = 0;
  // Upright concrete: permittivity 5.24 at 60 GHz (ITU-R P.2040-3). For sound, plaster reflects
  // 0.97.
  double radar_wall_reflectivity = 0.15, radar_wall_scatter = 1;
  double baseline_error_m = 0, radar_falloff = 0, radar_yaw_deg = 0, radar_psf_width = 1;

  // Antennas (sim/sensors/antennas.hpp) and body motions.
  std::int64_t radar_antennas = 0, radar_frames = 60;
  double radar_phase_error_rad = 0, radar_gain_error_db = 0;
  bool radar_array_calibrated = true;
  double radar_sway_m = 0.005, radar_twist_deg = 0.3, radar_breath_m = 0.004;

  // Depth camera and the maps.
  std::int64_t map_size = 64;
  double map_half_tangent = 0, map_z_max_m = 6;
  double depth_noise_m = 0, depth_dropout = 0, depth_offset_m = 0;
};

inline constexpr double reflector_m = 1;  // field of view of the antenna, +-50 degrees
inline constexpr double radar_half_tangent =
    1.2;  // field of view of the radar antenna, +-50 degrees
inline constexpr double radar_carrier_hz = 60.25e9;

// Binds all fields to keys of the same names; call validate() after reading.
void bind(Settings& settings, Conditions& conditions);
// Throws Error(config) for contradictory values and for an object that cannot be read.
void validate(const Conditions& conditions);

// Returns the number of detector rays across the field of view. The automatic number keeps the
// variance of the sampling error below a tenth of the shot-noise variance. With 256 rays and 1e5
// photons the error per bin is 0.29 of the shot noise (recon/python/examples/detail.py). It falls
// as rays^-3.65 and grows with the photons. With a margin of 25 % the number is
//   rays = 256 (3.6 signal_photons / 1e5)^(1/3.65), from 64 to 2048, even.
std::int64_t rays_of(const Conditions& conditions);

Axis spd_axis(const Conditions& conditions);
record::MapGrid map_grid(const Conditions& conditions);
Axis radar_axis(const Conditions& conditions);
RadarAxis radar_response(const Conditions& conditions);
// Response stated in the run: nominal values, without radar_psf_width.
record::Response stated_response(const Conditions& conditions);
double radar_x_m(const Conditions& conditions);  // true position of the radar

}  // namespace echofuse::sim

// SPDX-License-Identifier: MIT
// Parameters of the simulated world; the initialisers are the base condition. bind() in
// conditions.cpp documents each with its range (`echofuse-sim config` prints them). SPD and depth
// camera are at the origin and look along +z, x right, y up; the radar is at (-baseline_m, 0, 0).
#pragma once
#include <cstdint>
#include <string>

#include "acquire/measurement/depth_map.hpp"
#include "acquire/measurement/response.hpp"
#include "drivers/core/axis.hpp"
#include "drivers/program/settings.hpp"
#include "sim/scene/radar_axis.hpp"

namespace echofuse::sim {

struct Conditions {
  // Geometry and scenes. window_s is that of Lai et al., COL 22(2) 022701 (2024).
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

  // Letters. The base holds one 0.33 to 0.37 body heights before the chest, 0.02 above to 0.12 body
  // heights below the shoulders.
  double letter_albedo = 0.8, letter_scale = 1, letter_reach = 1, letter_lift_m = 0;
  double letter_tilt_deg = 0;

  // Reflectivity. A lobe of n = 2 alpha is the directive model of diffuse scattering
  // (Degli-Esposti et al., IEEE TAP 55, 143, 2007), whose ((1 + cos psi)/2)^alpha is cos^(2 alpha)
  // on the way back. It is scaled so that a sphere's echo stays.
  double radar_cloth = 1, radar_skin = 1, radar_plate = 1, radar_follows_albedo = 1;
  double radar_lobe = 1, radar_plate_lobe = 1, optical_lobe = 1;

  // SPD.
  std::int64_t spd_rays = 0;
  double irf_fwhm_ps = 200, irf_tail_ps = 0, irf_tail_share = 1;
  double bin_width_ps = 100, first_bin_ps = 13343;
  std::int64_t bins = 336;
  double signal_photons = 1e5, background_counts = 0, spd_delay_ps = 0;
  std::int64_t pulses_per_window = 0;
  double spd_dead_time_ps = 0;
  bool spd_detector_stated = true;
  // exp(-falloff t^2 / half_tangent^2) at tangent t from the middle, where the detector points.
  double spd_falloff = 0, spd_field = 1, spd_yaw_deg = 0;
  double slot_sway_m = 0;

  // Radar. Half of radar_rays go up and down, over half the tangent.
  std::int64_t radar_rays = 288;
  double radar_resolution_m = 0.5, radar_step_m = 0.25;
  std::int64_t radar_bins = 29;
  double radar_snr_db = 20, radar_bias_m = 0;
  std::string radar_psf = "sinc", radar_taps, radar_flanks, radar_sum = "incoherent";
  double radar_taper = 0, radar_leakage = 0;
  // Upright concrete: permittivity 5.24 at 60 GHz (ITU-R P.2040-3). Plaster mirrors 0.97 of sound.
  double radar_wall_reflectivity = 0.15, radar_wall_scatter = 1;
  double baseline_error_m = 0, radar_falloff = 0, radar_yaw_deg = 0, radar_psf_width = 1;

  // Its antennas (sim/sensors/antennas.hpp) and the motions of a standing person.
  std::int64_t radar_antennas = 0, radar_frames = 60;
  double radar_phase_error_rad = 0, radar_gain_error_db = 0;
  bool radar_array_calibrated = true;
  double radar_sway_m = 0.005, radar_twist_deg = 0.3, radar_breath_m = 0.004;

  // Depth camera and the maps.
  std::int64_t map_size = 64;
  double map_half_tangent = 0, map_z_max_m = 6;
  double depth_noise_m = 0, depth_dropout = 0, depth_offset_m = 0;
};

inline constexpr double reflector_m = 1;           // distance of the calibration reflector, along z
inline constexpr double radar_half_tangent = 1.2;  // its antenna's field of view, +-50 degrees
inline constexpr double radar_carrier_hz = 60.25e9;

// The keys are flat and named as the fields; call validate after reading.
void bind(Settings& settings, Conditions& conditions);
// Throws Error(config) for values that are each in range but contradict one another, and for an
// object that cannot be read.
void validate(const Conditions& conditions);

// Number of the detector's rays across the field of view. The automatic number keeps the sampling
// error below a tenth of the shot noise in variance. Per bin the error is 0.29 of the shot noise of
// 1e5 photons at 256 rays (recon/python/examples/detail.py), falls as rays^-3.65 and grows with the
// photons. With a quarter in reserve it is
//   rays = 256 (3.6 signal_photons / 1e5)^(1/3.65), from 64 to 2048, even.
std::int64_t rays_of(const Conditions& conditions);

Axis spd_axis(const Conditions& conditions);
record::MapGrid map_grid(const Conditions& conditions);
Axis radar_axis(const Conditions& conditions);
RadarAxis radar_response(const Conditions& conditions);
// Response that a run states: nominal values, without radar_psf_width.
record::Response stated_response(const Conditions& conditions);
double radar_x_m(const Conditions& conditions);  // true place of the radar

}  // namespace echofuse::sim

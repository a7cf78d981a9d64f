// SPDX-License-Identifier: MIT
// Here is every parameter of the simulated world; the initialisers are the base condition. Units
// are metres. SPD and depth camera are at the origin and look along +z, x right, y up; the radar is
// at (-baseline_m, 0, 0).
// [S] is Lai et al., COL 22(2) 022701 (2024).
#pragma once
#include <cstdint>
#include <string>

#include "acquire/measurement/depth_map.hpp"
#include "drivers/core/axis.hpp"
#include "drivers/program/settings.hpp"
#include "sim/scene/radar_axis.hpp"

namespace echofuse::sim {

struct Conditions {
  // Geometry and scenes.
  double window_s = 3;  // [S] exposure of one record
  double baseline_m = 0.5;
  double half_tangent = 0.55;    // field of view of SPD and depth camera, both ways
  double camera_height_m = 1.1;  // above the floor that people stand on
  double target_x_m = 1.0;       // people stand at -x..x
  double target_z_min_m = 3.0, target_z_max_m = 4.0;
  double target_scale = 1.0;        // size of people and letters
  double person_yaw_deg = 60;       // people turn up to this much from facing -z
  double letter_yaw_deg = 30;       // letters turn up to this much from facing the sensors
  std::string background = "none";  // or a room (room.hpp)
  // Largest number of reflections by walls, floor and ceiling on a way there and back, beside the
  // body's: of light (sim/sensors/multipath_light.hpp) and of the radar (multipath_radar.hpp). 0:
  // none.
  std::int64_t multipath_order = 0;
  std::string object;           // file of a triangle mesh (sim/scene/mesh.hpp) for object scenes
  double object_scale = 1;      // metres to one of its units
  std::string object_up = "y";  // y, z, -y

  // People (sim/scene/person.hpp). Factors refer to the base body.
  double height_min_m = 1.55, height_max_m = 1.90;
  double girth = 1;           // width and depth of the trunk
  double shoulder_width = 1;  //
  double limb_width = 1;      // arms and legs
  double leg_length = 1;      // the trunk makes up for it
  double body_spread = 0;     // share by which each of these four varies from person to person
  double pose_spread = 1;     // factor of the ranges of all joints' angles, about their middles
  double albedo_min = 0.3, albedo_max = 0.7;  // range for a person's clothes
  // Top, trousers, shoes and skin are each brighter or darker by up to this: exp(+-contrast).
  double albedo_contrast = 0;

  // Letters, and how they are held.
  double letter_albedo = 0.8;
  double letter_scale = 1;     // size of the plate
  double letter_reach = 1;     // distance from the chest, of the base's 0.33 to 0.37 body heights
  double letter_lift_m = 0;    // higher than the base, which is 0.02 above to 0.12 body heights
                               // below the shoulders
  double letter_tilt_deg = 0;  // leans forward or back by up to this
  // Reflectivity for the radar, as a factor of the optical albedo.
  double radar_cloth = 1, radar_skin = 1, radar_plate = 1;
  // With 1 the radar's reflectivity varies with the albedo of people's parts; with 0 it does not.
  double radar_follows_albedo = 1;
  // The echo per solid angle seen goes as cos^n of the incidence. n = 1 is Lambert. n = 2 alpha is
  // the directive model of diffuse scattering (Degli-Esposti et al., IEEE TAP 55, 143, 2007), whose
  // lobe ((1 + cos psi)/2)^alpha is cos^(2 alpha) on the way back. It is scaled so that a sphere's
  // echo stays.
  double radar_lobe = 1;        // cloth and skin
  double radar_plate_lobe = 1;  // the letter
  double optical_lobe = 1;      // the same power for people and letters in the detector's light

  // SPD. spd_rays: number of rays across the field of view, both ways; 0 means as many as
  // signal_photons ask for (rays_of).
  std::int64_t spd_rays = 0;
  double irf_fwhm_ps = 200;
  double irf_tail_ps = 0;     // time constant of an exponential tail; 0: Gaussian only
  double irf_tail_share = 1;  // share of the photons that it delays
  double bin_width_ps = 100;
  double first_bin_ps = 13343;  // two-way 2.0 m
  std::int64_t bins = 336;
  double signal_photons = 1e5;   // detections from the mean scene in one window
  double background_counts = 0;  // ambient and dark counts over all bins in one window
  double spd_delay_ps = 0;  // two-way delay of cables and electronics; the daemon does not know it
  // Laser pulses in a window. Only the first photon of a pulse counts, or, with a dead time, every
  // photon that comes when the detector is ready again. 0 means low flux.
  std::int64_t pulses_per_window = 0;
  double spd_dead_time_ps = 0;
  bool spd_detector_stated = true;  // the run states the detector, and its reader corrects for that
  // Light falls off towards the edges of the field of view: exp(-falloff t^2 / half_tangent^2) at
  // tangent t from the middle, where the detector points. The daemon takes it to look straight.
  double spd_falloff = 0;
  double spd_field = 1;    // the detector's field of view, in half_tangent
  double spd_yaw_deg = 0;  // towards +x
  double slot_sway_m = 0;  // rms motion of people along the line of sight in a record: blurs it

  // Radar. radar_rays: number of rays across the horizontal field of view; half as many go up and
  // down, over half its tangent.
  std::int64_t radar_rays = 288;
  double radar_resolution_m = 0.5;  // c / 2B
  double radar_step_m = 0.25;
  std::int64_t radar_bins = 29;
  double radar_snr_db = 20;        // below the mean scene's peak power
  double radar_bias_m = 0;         // its ranges are too long by this; the daemon does not know it
  std::string radar_psf = "sinc";  // sinc, hann, hamming, blackman: the window over its sweep
  // From nearly none to Blackman's (1) a window in place of radar_psf's; with 0 that one stays.
  double radar_taper = 0;
  // The power of the range response at the quarters of a cell (acquire/measurement/response.hpp),
  // in place of a window's; empty: as the window says.
  std::string radar_taps;
  std::string radar_sum = "incoherent";  // incoherent, coherent
  double radar_leakage = 0;  // power from transmitter to receiver at range 0, as radar_power
  // Share of the power that a wall mirrors (multipath_order). 0.15 is upright concrete
  // (permittivity 5.24 at 60 GHz, ITU-R P.2040-3). Plaster mirrors 0.97 of sound.
  double radar_wall_reflectivity = 0.15;
  // Factor of what Lambert's law gives for the radar's direct echoes from walls and furniture with
  // their optical albedo. Smooth walls scatter little.
  double radar_wall_scatter = 1;
  double baseline_error_m = 0;  // the true baseline is longer than baseline_m by this
  double radar_falloff = 0;     // like spd_falloff, over radar_half_tangent
  double radar_yaw_deg = 0;
  double radar_psf_width = 1;  // true width of its response, in widths of radar_resolution_m

  // Number of the radar's virtual antennas (sim/sensors/antennas.hpp): 1 to 8 in a row, or 12 as
  // the AOP board has them. 0 is like 1, and its samples are not kept.
  std::int64_t radar_antennas = 0;
  std::int64_t radar_frames = 60;    // frames in a record
  double radar_phase_error_rad = 0;  // rms over the antennas
  double radar_gain_error_db = 0;
  bool radar_array_calibrated = true;  // the run knows these errors
  // Motions that change a standing person's echoes from frame to frame (BodyMotion).
  double radar_sway_m = 0.005;    // rms each way, at head height
  double radar_twist_deg = 0.3;   // rms, about the upright axis
  double radar_breath_m = 0.004;  // amplitude of the chest

  // Depth camera.
  std::int64_t map_size = 64;   // pixels of a data set's depth maps, both ways
  double map_half_tangent = 0;  // at their edges; 0: half_tangent
  double map_z_max_m = 6;       // m; anything farther is no return in the maps
  double depth_noise_m = 0;     // sigma at 1 m; grows as z^2
  double depth_dropout = 0;     // share of the pixels at edges without return
  double depth_offset_m = 0;    // m that the camera reads too far
};

inline constexpr double reflector_m = 1;  // distance of the calibration target before each sensor
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

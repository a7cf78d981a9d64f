// SPDX-License-Identifier: MIT
#include "sim/scene/conditions.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "sim/scene/mesh.hpp"
#include "sim/scene/room.hpp"

namespace echofuse::sim {
namespace {

void bind_scene(Settings& s, Conditions& c) {
  s.add("window_s", c.window_s, 0.01, 3600,
        "length of a record, s; the settings for photon counts and radar frames are numbers per "
        "record");
  s.add("baseline_m", c.baseline_m, 0, 10,
        "distance of the radar from the detector, m; the radar is at x = -baseline_m");
  s.add("reflector_before", c.reflector_before,
        "position of the calibration reflector: in front of the detector (detector), in front of "
        "each sensor (each), or baseline_m to the left or right of the detector (left, right)",
        {"detector", "each", "left", "right"});
  s.add("reflector_z_m", c.reflector_z_m, 0.3, 10,
        "distance of the calibration reflector from the plane of the sensors, m");
  s.add("half_tangent", c.half_tangent, 0.05, 1,
        "tangent of half the field of view of the detector and of the depth camera");
  s.add("camera_height_m", c.camera_height_m, 0, 3, "height of the sensors above the floor, m");
  s.add("target_x_m", c.target_x_m, 0, 5, "largest |x| of people and objects, m");
  s.add("target_z_min_m", c.target_z_min_m, 1.2, 20,
        "smallest distance of people and objects from the sensors, m");
  s.add("target_z_max_m", c.target_z_max_m, 1.2, 20,
        "largest distance of people and objects from the sensors, m");
  s.add("target_scale", c.target_scale, 0.1, 3, "factor by which people and letters are scaled");
  s.add("person_yaw_deg", c.person_yaw_deg, 0, 180, "largest |yaw| of people, degrees");
  s.add("letter_yaw_deg", c.letter_yaw_deg, 0, 80,
        "largest |yaw| of letters relative to the direction towards the sensors, degrees");
  s.add("object", c.object, "OBJ file with the mesh for object scenes");
  s.add("object_scale", c.object_scale, 1e-6, 1e6, "length of one unit of the mesh, m");
  s.add("object_up", c.object_up,
        "axis of the mesh that points up; -y: y points down, as in camera coordinates",
        {"y", "z", "-y"});
  s.add("background", c.background, "type of room behind the people; none: no room", room_names());
  s.add("multipath_order", c.multipath_order, 0, 2,
        "largest number of reflections from walls, floor and ceiling in one path");
}

void bind_people(Settings& s, Conditions& c) {
  s.add("height_min_m", c.height_min_m, 0.5, 2.5, "height of the shortest person, m");
  s.add("height_max_m", c.height_max_m, 0.5, 2.5, "height of the tallest person, m");
  s.add("girth", c.girth, 0.3, 3, "width of the trunk, relative to the default body");
  s.add("shoulder_width", c.shoulder_width, 0.3, 3,
        "width of the shoulders, relative to the default body");
  s.add("limb_width", c.limb_width, 0.3, 3,
        "width of the arms and legs, relative to the default body");
  s.add("leg_length", c.leg_length, 0.7, 1.4,
        "length of the legs, relative to the default body; the total height does not change");
  s.add("body_spread", c.body_spread, 0, 0.5,
        "relative variation of girth, shoulder_width and limb_width between people; the variation "
        "of leg_length is a quarter of this value");
  s.add("pose_spread", c.pose_spread, 0, 1.5,
        "width of the ranges of joint angles, relative to the default ranges");
  s.add("albedo_min", c.albedo_min, 0, 1, "albedo of the darkest clothes");
  s.add("albedo_max", c.albedo_max, 0, 1, "albedo of the brightest clothes");
  s.add("albedo_contrast", c.albedo_contrast, 0, 3,
        "the albedos of top, trousers, shoes and skin are each multiplied by a random factor from "
        "exp(-albedo_contrast) to exp(albedo_contrast)");
}

void bind_letters(Settings& s, Conditions& c) {
  s.add("letter_albedo", c.letter_albedo, 0, 1, "albedo of letters");
  s.add("letter_scale", c.letter_scale, 0.2, 3, "factor by which letters are scaled");
  s.add("letter_reach", c.letter_reach, 0.3, 1.5,
        "distance of letters from the chest, relative to the default distance");
  s.add("letter_lift_m", c.letter_lift_m, -1, 1,
        "height added to the default height of letters, m");
  s.add("letter_tilt_deg", c.letter_tilt_deg, 0, 80,
        "largest forward or backward tilt of letters, degrees");
}

void bind_reflectivity(Settings& s, Conditions& c) {
  s.add("radar_cloth", c.radar_cloth, 0, 100,
        "radar reflectivity of cloth, relative to the optical albedo");
  s.add("radar_skin", c.radar_skin, 0, 100,
        "radar reflectivity of head and neck, relative to the optical albedo");
  s.add("radar_plate", c.radar_plate, 0, 100,
        "radar reflectivity of letters, relative to the optical albedo");
  s.add("radar_follows_albedo", c.radar_follows_albedo, 0, 1,
        "fraction of the albedo variation of clothes and skin that affects the radar");
  s.add("radar_lobe", c.radar_lobe, 0, 20,
        "exponent n of the radar echo of people, which is proportional to cos^n of the angle of "
        "incidence; 1: Lambertian");
  s.add("radar_plate_lobe", c.radar_plate_lobe, 0, 20,
        "exponent n of the radar echo of letters and objects, which is proportional to cos^n of "
        "the angle of incidence; 1: Lambertian");
  s.add("optical_lobe", c.optical_lobe, 0, 20,
        "exponent n of the light reflected by people, letters and objects, which is proportional "
        "to cos^n of the angle of incidence; 1: Lambertian");
}

void bind_spd(Settings& s, Conditions& c) {
  s.add("spd_rays", c.spd_rays, 0, 2048,
        "number of simulated rays across the field of view of the detector, at least 16; 0: "
        "derived from signal_photons");
  s.add("spd_zones", c.spd_zones, 1, 8,
        "number of detector zones along x, and also along y; one of 1, 3, 4 or 8");
  s.add("irf_fwhm_ps", c.irf_fwhm_ps, 0.1, 100'000,
        "full width at half maximum of the Gaussian impulse response, ps");
  s.add("irf_tail_ps", c.irf_tail_ps, 0, 100'000,
        "time constant of the exponential tail of the impulse response, ps; 0: no tail");
  s.add("irf_tail_share", c.irf_tail_share, 0, 1,
        "fraction of the photons that are in the exponential tail");
  s.add("bin_width_ps", c.bin_width_ps, 1, 100'000, "bin width of the detector histogram, ps");
  s.add("first_bin_ps", c.first_bin_ps, 0, 1e6,
        "two-way time at the start of bin 0 of the detector histogram, ps");
  s.add("bins", c.bins, 1, 65'536, "number of bins of the detector histogram");
  s.add("signal_photons", c.signal_photons, 0, 1e9,
        "number of signal detections per record for an average scene");
  s.add("background_counts", c.background_counts, 0, 1e9,
        "number of ambient and dark counts per record");
  s.add("spd_delay_ps", c.spd_delay_ps, -1e6, 1e6,
        "two-way delay of cables and electronics, ps; not stored in the run file");
  s.add("pulses_per_window", c.pulses_per_window, 0, 1'000'000'000'000,
        "number of laser pulses per record; only the first photon of each pulse is detected "
        "(pile-up); 0: no pile-up");
  s.add("spd_dead_time_ps", c.spd_dead_time_ps, 0, 1e9,
        "dead time of a free-running detector, ps; 0: at most one photon per pulse is detected");
  s.add("spd_detector_stated", c.spd_detector_stated,
        "store the dead time or the first-photon mode of the detector in the run file");
  s.add("spd_falloff", c.spd_falloff, 0, 10,
        "the photon signal from the edges of the field of view is multiplied by exp(-spd_falloff)");
  s.add("spd_field", c.spd_field, 0.1, 3,
        "field of view of the detector, relative to half_tangent");
  s.add("spd_yaw_deg", c.spd_yaw_deg, -30, 30,
        "yaw of the detector towards +x, degrees; not stored in the run file");
  s.add("slot_sway_m", c.slot_sway_m, 0, 1, "rms change of the range of people within a record, m");
}

void bind_radar(Settings& s, Conditions& c) {
  s.add("radar_rays", c.radar_rays, 16, 2048,
        "number of simulated rays across the field of view of the radar");
  s.add("radar_resolution_m", c.radar_resolution_m, 0.001, 10,
        "range resolution c / 2B of the radar, m (B: bandwidth)");
  s.add("radar_step_m", c.radar_step_m, 0.001, 10,
        "distance between neighbouring points of the range profile, m");
  s.add("radar_bins", c.radar_bins, 1, 65'536, "number of points of the range profile");
  s.add("radar_snr_db", c.radar_snr_db, -40, 200,
        "peak of an average scene divided by the rms noise of a profile that is averaged over 60 "
        "frames, dB");
  s.add("radar_bias_m", c.radar_bias_m, -10, 10,
        "bias added to the ranges of the radar, m; not stored in the run file");
  s.add(
      "radar_psf", c.radar_psf,
      "window function over the radar sweep, which determines the range response; sinc: no window",
      {"sinc", "hann", "hamming", "blackman"});
  s.add("radar_taper", c.radar_taper, 0, 1,
        "strength of the window function over the radar sweep, from almost no window (near 0) to "
        "Blackman (1); 0: use radar_psf");
  s.add("radar_taps", c.radar_taps,
        "powers of the range response in steps of 1/4 resolution cell; the peak is 1 and at range "
        "0; a list that begins with the peak is symmetric; replaces the window function");
  s.add("radar_sum", c.radar_sum,
        "how radar echoes are added: as powers (incoherent) or as amplitudes (coherent)",
        {"incoherent", "coherent"});
  s.add("radar_leakage", c.radar_leakage, 0, 1e6,
        "power of the transmitter leakage at range 0, relative to the peak of an average scene");
  s.add("radar_wall_reflectivity", c.radar_wall_reflectivity, 0, 1,
        "specular power reflectivity of walls for the radar; only used if multipath_order > 0");
  s.add("radar_wall_scatter", c.radar_wall_scatter, 0, 1,
        "diffuse radar reflectivity of walls and furniture, relative to the optical albedo");
  s.add("baseline_error_m", c.baseline_error_m, -1, 1,
        "true distance between detector and radar minus baseline_m, m");
  s.add("radar_falloff", c.radar_falloff, 0, 10,
        "the radar echo from the edges of the field of view is multiplied by exp(-radar_falloff)");
  s.add("radar_yaw_deg", c.radar_yaw_deg, -45, 45,
        "yaw of the radar towards +x, degrees; not stored in the run file");
  s.add("radar_psf_width", c.radar_psf_width, 0.3, 3,
        "true width of the range response, relative to the width in the run file");
}

void bind_array(Settings& s, Conditions& c) {
  s.add("radar_antennas", c.radar_antennas, 0, 12,
        "number of virtual antennas of the radar: 1 to 8 in a row, or 12 in a plane; 0: one "
        "antenna, and the run file contains no antenna data");
  s.add("radar_frames", c.radar_frames, 1, 10'000,
        "number of radar frames per record; must exceed radar_antennas");
  s.add("radar_phase_error_rad", c.radar_phase_error_rad, 0, 10,
        "rms phase error of the antennas, rad");
  s.add("radar_gain_error_db", c.radar_gain_error_db, 0, 20, "rms gain error of the antennas, dB");
  s.add("radar_array_calibrated", c.radar_array_calibrated,
        "store the gain and phase errors of the antennas in the run file");
  s.add("radar_sway_m", c.radar_sway_m, 0, 1,
        "rms sway of a standing person's head along each axis, m");
  s.add("radar_twist_deg", c.radar_twist_deg, 0, 90,
        "rms rotation of a person about the vertical axis, degrees");
  s.add("radar_breath_m", c.radar_breath_m, 0, 0.1,
        "amplitude of the breathing motion of the chest, m");
}

void bind_depth(Settings& s, Conditions& c) {
  s.add("map_size", c.map_size, record::min_map_size, record::max_map_size,
        "number of pixels per side of the depth maps");
  s.add("map_half_tangent", c.map_half_tangent, 0, record::max_map_half_tangent,
        "x/z and y/z at the edges of the depth maps; 0: the value of half_tangent");
  s.add("map_z_max_m", c.map_z_max_m, record::min_map_far_m, record::max_map_far_m,
        "largest depth in the depth maps, m; points that are farther away are stored as \"no "
        "return\"");
  s.add(
      "depth_noise_m", c.depth_noise_m, 0, 1,
      "rms depth noise at a depth of 1 m, m; the noise is proportional to the square of the depth");
  s.add("depth_dropout", c.depth_dropout, 0, 1,
        "fraction of the pixels at depth edges that have no return");
  s.add("depth_offset_m", c.depth_offset_m, -1, 1,
        "bias added to the depths of the depth camera, m");
}

record::RadarResponse measured_response(const Conditions& c) {
  return record::response_of({{"radar_cell_m", "1"}, {"radar_taps", c.radar_taps}}).radar;
}

Psf psf_of(const record::RadarResponse& response) {
  const std::vector<double>& taps = response.taps;
  Psf out{.zero = static_cast<double>(response.peak())};
  if (!taps.empty() && out.zero == 0) {
    out.taps.assign(taps.rbegin(), taps.rend() - 1);
    out.zero = static_cast<double>(out.taps.size());
  }
  out.taps.insert(out.taps.end(), taps.begin(), taps.end());
  for (double& tap : out.taps) tap = std::sqrt(tap);
  return out;
}

Psf range_response(const Conditions& c) {
  Psf out = c.radar_psf == "hann"       ? Psf::hann()
            : c.radar_psf == "hamming"  ? Psf::hamming()
            : c.radar_psf == "blackman" ? Psf::blackman()
                                        : Psf::sinc();
  if (c.radar_taper > 0) out = Psf::tapered(c.radar_taper);
  return c.radar_taps.empty() ? out : psf_of(measured_response(c));
}

}  // namespace

void bind(Settings& settings, Conditions& conditions) {
  bind_scene(settings, conditions);
  bind_people(settings, conditions);
  bind_letters(settings, conditions);
  bind_reflectivity(settings, conditions);
  bind_spd(settings, conditions);
  bind_radar(settings, conditions);
  bind_array(settings, conditions);
  bind_depth(settings, conditions);
}

std::int64_t rays_of(const Conditions& c) {
  if (c.spd_rays > 0) return c.spd_rays;
  const double rays = 256 * std::pow(3.6 * c.signal_photons / 1e5, 1 / 3.65);
  return 2 * static_cast<std::int64_t>(std::ceil(std::clamp(rays, 64.0, 2048.0) / 2));
}

void validate(const Conditions& c) {
  if (c.spd_rays > 0 && c.spd_rays < 16)
    throw Error(ExitCode::config, "spd_rays is " + std::to_string(c.spd_rays) +
                                      "; expected 0, or a whole number from 16 to 2048");
  if (c.spd_zones == 2 || (c.spd_zones > 4 && c.spd_zones < 8))
    throw Error(ExitCode::config,
                "spd_zones is " + std::to_string(c.spd_zones) + "; expected 1, 3, 4 or 8");
  if (c.spd_zones > 1 && c.multipath_order > 0)
    throw Error(ExitCode::config,
                "spd_zones > 1 cannot be combined with multipath_order > 0, because the simulated "
                "light from walls has no direction");
  if (c.spd_dead_time_ps > 0 && c.pulses_per_window == 0)
    throw Error(ExitCode::config, "spd_dead_time_ps needs pulses_per_window > 0");
  if (c.map_half_tangent > 0 && c.map_half_tangent < record::min_map_half_tangent)
    throw Error(ExitCode::config, "map_half_tangent: expected 0, or 0.02 to 3");
  if (c.radar_antennas > 8 && c.radar_antennas != 12)
    throw Error(ExitCode::config, "radar_antennas is " + std::to_string(c.radar_antennas) +
                                      "; expected 0 to 8, or 12");
  if (c.radar_antennas > 0 && c.radar_frames <= c.radar_antennas)
    throw Error(ExitCode::config, "radar_frames is " + std::to_string(c.radar_frames) +
                                      "; expected more than radar_antennas");
  if (c.target_z_min_m > c.target_z_max_m)
    throw Error(ExitCode::config, "target_z_min_m is greater than target_z_max_m");
  if (c.height_min_m > c.height_max_m)
    throw Error(ExitCode::config, "height_min_m is greater than height_max_m");
  if (c.albedo_min > c.albedo_max)
    throw Error(ExitCode::config, "albedo_min is greater than albedo_max");
  if (!c.radar_taps.empty() && !measured_response(c).known())
    throw Error(ExitCode::config,
                "radar_taps: expected 3 to 64 numbers from 0 to 1.05 with a peak of 1");
  if (!c.object.empty()) object_text(c);
}

std::string object_text(const Conditions& c) {
  constexpr std::size_t max_triangles = 50'000;
  const Mesh& mesh = mesh_of(c.object);
  const Vec3 size = c.object_scale * size_of(mesh);
  const std::string found =
      printable(c.object) + format(": %.3g x %.3g x %.3g m, %zu triangles", size.x, size.y, size.z,
                                   mesh.triangles.size());
  const double longest_m = std::max({size.x, size.y, size.z}),
               pixel_m = 2 * c.half_tangent * c.target_z_min_m / static_cast<double>(c.map_size);
  if (mesh.triangles.size() > max_triangles)
    throw Error(ExitCode::config, found + "; expected at most " + std::to_string(max_triangles) +
                                      "; more triangles take minutes");
  if (!(longest_m <= c.map_z_max_m && longest_m >= pixel_m))
    throw Error(
        ExitCode::config,
        found + format("; expected a longest side from %.2g m (a pixel) to %.3g m (map_z_max_m); "
                       "set object_scale, e.g. to 0.001 if the unit is mm",
                       pixel_m, c.map_z_max_m));
  return found;
}

Axis spd_axis(const Conditions& c) {
  return echofuse::spd_axis(static_cast<std::uint32_t>(c.bins), c.first_bin_ps, c.bin_width_ps);
}

record::MapGrid map_grid(const Conditions& c) {
  return {static_cast<std::uint32_t>(c.map_size),
          c.map_half_tangent > 0 ? c.map_half_tangent : c.half_tangent, c.map_z_max_m};
}

Axis radar_axis(const Conditions& c) {
  return range_axis("power", static_cast<std::uint32_t>(c.radar_bins), 0, c.radar_step_m);
}

record::Response stated_response(const Conditions& c) {
  constexpr double farthest_cells = 6, step_cells = 1. / record::RadarResponse::taps_a_cell;
  const Psf psf = range_response(c);
  record::Response out;
  out.irf_fwhm_ps.value = c.irf_fwhm_ps;
  out.irf_tail_ps.value = c.irf_tail_ps, out.irf_tail_share.value = c.irf_tail_share;
  out.radar.cell_m = c.radar_resolution_m;
  if (!c.radar_taps.empty())
    out.radar.taps = measured_response(c).taps;
  else
    for (double u = 0; u < farthest_cells; u += step_cells)
      out.radar.taps.push_back(std::pow(psf.at(u), 2) / std::pow(psf.at(0), 2));
  return out;
}

RadarAxis radar_response(const Conditions& c) {
  return {0, c.radar_step_m, static_cast<std::uint32_t>(c.radar_bins),
          c.radar_resolution_m * c.radar_psf_width, range_response(c)};
}

double radar_x_m(const Conditions& c) { return -(c.baseline_m + c.baseline_error_m); }

}  // namespace echofuse::sim

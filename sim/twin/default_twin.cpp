// SPDX-License-Identifier: MIT
#include "sim/twin/twin.hpp"

namespace echofuse::sim {

const std::string& default_twin() {
  static const std::string text =
      R"(# What rooms and laboratories differ in. Each laboratory draws each key once:
#   key = [low, high]          uniform
#   key = [low, high, "log"]   its logarithm uniform
# Without a source: our choice. The base condition lies inside every range.
seed = 1  # another seed, other laboratories

# People. Factors are of the base body.
height_min_m = [1.48, 1.65]
height_max_m = [1.76, 1.96]
girth = [0.75, 1.45, "log"]
shoulder_width = [0.85, 1.2, "log"]
limb_width = [0.75, 1.45, "log"]
leg_length = [0.94, 1.06]
body_spread = [0, 0.15]
pose_spread = [0.5, 1.2]
person_yaw_deg = [30, 90]
camera_height_m = [0.95, 1.3]

# Clothes and incidence in light
albedo_min = [0.1, 0.5]
albedo_max = [0.5, 0.9]
albedo_contrast = [0, 0.8]
optical_lobe = [0.7, 1.5, "log"]

# Letters and how they are held
letter_albedo = [0.5, 0.95]
letter_scale = [0.8, 1.25, "log"]
letter_reach = [0.65, 1.15]
letter_lift_m = [-0.2, 0.15]
letter_tilt_deg = [0, 25]
letter_yaw_deg = [15, 45]

# Radar's reflectivity, of the optical albedo (base 0.5). Skin sends back 34 to 42 % of the power
# at 60 GHz (Wu, Rappaport, Collins, IEEE ICC 2015); it varies with the horny layer (Christ et al.,
# Bioelectromagnetics 42, 2021). Cloth is transparent (Bjarnason et al., Appl. Phys. Lett. 85, 519,
# 2004), and the air under it makes the skin's reflection rise and fall ("Monte Carlo Simulation of
# Clothed Skin Exposure to Electromagnetic Field With Oblique Incidence Angles at 60 GHz", Front.
# Public Health 10, 795414, 2022). A plate may be cardboard or foil.
radar_cloth = [0.5, 1.6, "log"]
radar_skin = [0.5, 1.5, "log"]
radar_plate = [0.15, 3, "log"]
radar_follows_albedo = [0, 1]
# Lambert's law was fitted to building materials at 60 GHz (Lu et al., "Propagation Characterization
# of an Office Building in the 60 GHz Band", 2014), the directive model to rougher and smoother ones
# (Ju et al., "Scattering Mechanisms and Modeling for Terahertz Wireless Communications", 2019).
# Brewster's angle makes cloth darker at grazing incidence of one polarisation, brighter of the
# other: both powers of the cosine are possible.
radar_lobe = [0.6, 2, "log"]
radar_plate_lobe = [0.6, 3, "log"]

# What the run does not state rightly
baseline_error_m = [-0.01, 0.01]
radar_bias_m = [-0.004, 0.004]
spd_delay_ps = [-15, 15]
spd_yaw_deg = [-2, 2]
radar_yaw_deg = [-3, 3]
spd_field = [0.9, 1.1]

# Detector
irf_fwhm_ps = [150, 280, "log"]
irf_tail_ps = [0, 100]
irf_tail_share = [0.1, 1]
signal_photons = [4e4, 2.5e5, "log"]
background_counts = [0, 2e4]
spd_falloff = [0, 0.5]
# Standing people sway by millimetres, shift and breathe.
slot_sway_m = [0, 0.008]

# Radar. Of an EVM the whole path is 12 dB down at the edge of the -6 dB beam (TI, SWRU585), some 55
# degrees: exp(-2) at the tangent 1.2.
radar_snr_db = [17, 23]
radar_psf_width = [0.96, 1.05, "log"]
radar_taper = [0, 1]  # the window over the sweep, from none to Blackman's
radar_leakage = [0, 0.2]
radar_falloff = [0, 1.5]

# Depth camera. Stereo: noise and steps grow with the square (Grunnet-Jepsen et al., "Subpixel
# Linearity Improvement for Intel RealSense Depth Camera D400 Series").
depth_noise_m = [0, 0.002]
depth_offset_m = [-0.01, 0.01]
depth_dropout = [0, 0.3]
)";
  return text;
}

}  // namespace echofuse::sim

// SPDX-License-Identifier: MIT
// How well the radar's antennas tell a lateral position: the Cramer-Rao bound of the azimuth, which
// is all that the SPD's histogram cannot tell. Everything else (range, shape, the scatterers' mean
// powers) is taken as known but for the radar's gain.
//
// The samples of all range points and antennas in a frame are complex Gaussian, zero mean, with
// covariance C = R + nu 1, where R = sum_k w_k q_k q_k^H over the patches of the body, q being psf
// times wave, and nu the noise. The information of L independent looks (frames) is
//   coherent    L tr(C^-1 dC_p C^-1 dC_q)      (Kay, Estimation Theory, 1993, 15.7; van Trees 2002,
//               8.2): amplitudes are speckle, new in each look
//   incoherent  the same with the echoes' covariance exactly R in every record, as the simulated
//               array has it (sim/sensors/radar_array.hpp): only noise scatters the covariance, and
//               an element between eigenvectors i, j of R varies by nu (l_i + l_j + nu) instead of
//               (l_i + nu)(l_j + nu)
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "sim/study/bound.hpp"

namespace echofuse::sim {

// What is known of the azimuth from where.
enum class ArrayUse : std::uint8_t {
  range,  // one antenna; the radar's ranges are right
  angle,  // all antennas; the radar's ranges have an unknown bias
  both    // all antennas; the radar's ranges are right
};
inline const std::vector<std::string> array_use_names = {"range", "angle", "both"};

struct ArrayBound {
  std::string echoes;  // coherent, incoherent
  std::string axis;    // looks, snr_db, antennas, phase_error_deg; the others at 60, 20 dB, 8 and 0
  double value = 0;
  double resolution_m = 0;
  ArrayUse use = ArrayUse::both;
  double lateral_error_m = 0;  // mean over scenes of sqrt(2/pi) sigma; infinite: not told
};

// phase_error_deg: of each antenna, an unknown with a Gaussian prior of this deviation. Throws
// Error(interrupted).
std::vector<ArrayBound> study_array_bound(const BoundOptions& options);

std::string to_text(const std::vector<ArrayBound>& rows);  // a table
// bound_array.csv in `folder`, which exists. Throws Error(disk).
void write_array_bound(const std::vector<ArrayBound>& rows, const std::string& folder);

}  // namespace echofuse::sim

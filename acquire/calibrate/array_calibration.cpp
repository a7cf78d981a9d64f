// SPDX-License-Identifier: MIT
#include "acquire/calibrate/array_calibration.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "acquire/calibrate/peak.hpp"
#include "drivers/core/median.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::acquire {
namespace {

using AntennaSamples = Eigen::MatrixXcd;  // rows: antennas; columns: frames

constexpr std::size_t min_frames = 8;
constexpr double min_snr_db = 10;
constexpr double min_share = 0.9;  // minimum fraction of the total power in the strongest wave
constexpr double weakest_gain = 0.03;
// Mean square of the rounding error of the real or imaginary part of a sample, because the error
// is uniformly distributed over one step.
constexpr double rounding_power = 1.0 / 12;

std::complex<double> sample(const std::vector<std::int16_t>& frame, std::size_t i) {
  return {static_cast<double>(frame[2 * i + 1]), static_cast<double>(frame[2 * i])};
}

// Returns the power in each bin, summed over the antennas and averaged over the frames.
std::vector<double> powers_of(const ArrayFrames& frames, std::size_t antennas) {
  std::vector<double> powers(frames[0].size() / (2 * antennas));
  for (const auto& frame : frames)
    for (std::size_t i = 0; i < powers.size() * antennas; ++i)
      powers[i / antennas] += std::norm(sample(frame, i)) / static_cast<double>(frames.size());
  return powers;
}

double turn(double phase) { return std::remainder(phase, 2 * std::numbers::pi); }

AntennaFit fit_wave(const AntennaSamples& x) {
  AntennaFit fit;
  const auto frames = static_cast<double>(x.cols()), antennas = static_cast<double>(x.rows());
  const AntennaSamples covariance = x * x.adjoint() / frames;
  const Eigen::SelfAdjointEigenSolver<AntennaSamples> solver(covariance);
  const double all = covariance.trace().real(), wave = solver.eigenvalues().maxCoeff();
  if (!(wave >= min_share * all)) {
    fit.refusal = format(
        "more than one echo: the strongest wave has %.0f %% of the power (at least 90 %%"
        " needed)",
        100 * wave / all);
    return fit;
  }
  // Eigen sorts the eigenvalues in ascending order, so the last eigenvector is the principal one.
  const Eigen::VectorXcd a = solver.eigenvectors().col(x.rows() - 1);
  const double noise = antennas > 1 ? std::max(0.0, all - wave) / (antennas - 1) : 0;
  for (Eigen::Index m = 0; m < a.size(); ++m) {
    const std::complex<double> z = a[m] / a[0];
    if (!(std::abs(z) > weakest_gain && std::abs(z) < 1 / weakest_gain)) {
      fit.refusal = format(
          "the gain of antenna %d relative to antenna 0 is %.0f dB: one of them has no signal",
          static_cast<int>(m), 20 * std::log10(std::abs(z)));
      return fit;
    }
    const double inverse = (1 / std::norm(a[m]) + 1 / std::norm(a[0])) / wave;
    fit.gains.gain.push_back(std::abs(z));
    fit.gains.phase_rad.push_back(std::arg(z));
    fit.gains.standard_error.push_back(
        m == 0 ? 0 : std::sqrt((noise / (2 * frames) + rounding_power) * inverse));
  }
  return fit;
}

}  // namespace

AntennaFit fit_antennas(const ArrayFrames& frames, std::size_t antennas, std::size_t bin) {
  AntennaFit fit;
  if (frames.size() < min_frames)
    return {.gains = {}, .refusal = "fewer than 8 frames with antenna samples received"};
  const std::vector<double> powers = powers_of(frames, antennas);
  std::size_t top = std::min(bin, powers.size() - 1);
  for (const std::size_t near : {top - std::min<std::size_t>(top, 1), top + 1})
    if (near < powers.size() && powers[near] > powers[top]) top = near;
  const double snr_db = 10 * std::log10(powers[top] / std::max(median(powers), 1e-9));
  if (!(snr_db >= min_snr_db)) {
    fit.refusal = format(
        "no peak in the antenna samples at the reflector: peak/median %.1f dB"
        " (at least 10 dB needed)",
        snr_db);
    return fit;
  }
  AntennaSamples x(static_cast<Eigen::Index>(antennas), static_cast<Eigen::Index>(frames.size()));
  for (Eigen::Index f = 0; f < x.cols(); ++f)
    for (Eigen::Index m = 0; m < x.rows(); ++m)
      x(m, f) =
          sample(frames[static_cast<std::size_t>(f)], top * antennas + static_cast<std::size_t>(m));
  fit = fit_wave(x);
  fit.snr_db = snr_db;
  return fit;
}

void widen(AntennaGains& all, const std::vector<AntennaGains>& repeats) {
  for (std::size_t m = 1; m < all.gain.size(); ++m) {
    std::vector<double> phases, gains;
    for (const AntennaGains& r : repeats) {
      phases.push_back(turn(r.phase_rad[m] - all.phase_rad[m]));
      gains.push_back(std::log(r.gain[m] / all.gain[m]));
    }
    double& error = all.standard_error[m];
    error = std::max(honest_error(error, phases), honest_error(error, gains));
  }
}

void remove_steering(AntennaGains& gains, const Steering& steering) {
  gains.sine = steering.sine;
  for (std::size_t m = 0; m < gains.phase_rad.size(); ++m) {
    gains.phase_rad[m] = turn(gains.phase_rad[m] - steering.phase_rad[m]);
    gains.standard_error[m] = std::hypot(gains.standard_error[m], steering.error_rad[m]);
  }
}

double largest_residual(const AntennaGains& a, const AntennaGains& b) {
  double worst = 0;
  for (std::size_t m = 1; m < std::min(a.gain.size(), b.gain.size()); ++m) {
    const double error = std::hypot(a.standard_error[m], b.standard_error[m]);
    const double off = std::max(std::abs(turn(a.phase_rad[m] - b.phase_rad[m])),
                                std::abs(std::log(a.gain[m] / b.gain[m])));
    worst = std::max(worst, off / std::max(error, 1e-9));
  }
  return worst;
}

std::string to_text(const AntennaFit& fit) {
  if (!fit.refusal.empty()) return "array  rejected: " + fit.refusal + "\n";
  constexpr double degree = std::numbers::pi / 180;
  const AntennaGains& g = fit.gains;
  std::string text = format("array  %zu antennas, SNR %.0f dB; relative to antenna 0:\n",
                            g.gain.size(), fit.snr_db);
  for (std::size_t m = 1; m < g.gain.size(); ++m)
    text += format("array  antenna %zu: gain %.4f +- %.4f, phase %+.2f +- %.2f degrees\n", m,
                   g.gain[m], g.gain[m] * g.standard_error[m], g.phase_rad[m] / degree,
                   g.standard_error[m] / degree);
  return text;
}

}  // namespace echofuse::acquire

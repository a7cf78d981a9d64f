// SPDX-License-Identifier: MIT
// Least squares of one record's histogram and profile to what its depth map shows.
#pragma once
#include <Eigen/Dense>
#include <vector>

#include "sim/fit/surface.hpp"
#include "sim/scene/conditions.hpp"

namespace echofuse::sim {

// Brightness of the parts per patch weight / range^2, in the sensor's unit; 0: not to be seen.
struct LightFit {
  double torso = 0, legs = 0, head = 0, plate = 0;
  double expected = 0;           // sum of all patches' weight / range^2
  std::vector<double> rendered;  // counts by range without the detector's response, as fitted
};
// `counts` without background.
LightFit fit_light(const Surface& surface, const std::vector<double>& counts, const Conditions& c);

struct EchoFit {
  double body = 0, plate = 0, expected = 0;
  double shift_m = 0;  // ranges too long by this
  double width = 0;    // of the response, of the stated one's, minus 1
  double peak = 0, noise = 0, leakage = 0, behind = 0;  // noise: rms of what is left
  double sine = 0;                                      // of the azimuth that the radar's echo has
};
EchoFit fit_echo(const Surface& surface, const std::vector<double>& power, const Conditions& c);

// The response that turns rendered histograms into measured ones: a Gaussian, and a share of it
// with an exponential tail of 150 ps. Least squares over many records, each with its own
// brightness.
class ResponseFit {
 public:
  explicit ResponseFit(const Conditions& c) : bin_ps_(c.bin_width_ps) {}
  void add(std::vector<double> rendered, std::vector<double> counts);
  struct Response {
    double delay_ps = 0, sigma_ps = 85, tail_share = 0;
  };
  Response solve() const;

 private:
  struct Record {
    std::vector<double> rendered, counts, weight;
  };
  Eigen::VectorXd residual(const Response& r) const;
  double bin_ps_;
  std::vector<Record> records_;
};

}  // namespace echofuse::sim

// SPDX-License-Identifier: MIT
// Converts the radar profiles of a run to the radar response of a model's training data. A run
// contains the response of its radar to a point target (acquire/measurement/response.hpp). The
// conversion is a linear filter. It is exact for incoherent echoes, because their powers add up;
// for coherent echoes it is correct on average.
#pragma once
#include <string>
#include <vector>

#include "drivers/core/random.hpp"
#include "recon/data/dataset.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

// Returns the 2n + 1 weights of a filter that converts samples of the response `own` to samples of
// the response `expected`. Samples are `step_m` apart. The weights apply to the samples from n
// steps before to n steps after the output sample. The filter is a Wiener filter: the least-squares
// solution for noise 20 dB below the peak in each sample.
std::vector<double> response_filter(const record::RadarResponse& own,
                                    const record::RadarResponse& expected, double step_m);

// Radar response of the training data of a model.
struct ModelResponse {
  record::RadarResponse radar;  // unknown if the training runs do not contain it
  // The training runs need not include their radar responses, which may then differ.
  bool any = false;

  ModelResponse() = default;
  // Chooses the widest radar response of the runs, because conversion to a wider response adds no
  // noise. The result is unknown if no run includes its response.
  explicit ModelResponse(const Dataset& data, bool any_of_runs = false);

  // Filters the radar profiles and lags of each run that includes its radar response, and stores
  // the new response in the run's Source. Does not change other runs, binned power, or the rows of
  // a dead sensor. If `any` is true, responses much narrower than `radar` are not converted either,
  // because widening them would reduce the accuracy.
  void convert(Dataset& data) const;
  // Returns a note if the data set lacks a response that this model needs; otherwise empty.
  std::string note(const Dataset& data) const;
  void archive(Archive archive);
};

// Returns those responses of the sweep windows cos^2, cos^4, cos^6 and cos^8 (Harris, Proc. IEEE
// 66, 1978) that are at least 5 % wider than `than`, with the narrowest first.
std::vector<record::RadarResponse> wider_responses(const record::RadarResponse& than);

// Standard deviations of the noise in each value of a bin, for each column of the radar. Estimated
// as the lower quartile over the bins, because bins with bodies vary more between records.
using RadarNoise = std::vector<std::vector<float>>;
RadarNoise radar_noise(const Dataset& data, const Rows& rows);

// Radars with wider responses (wider_responses) than that of the training data.
class WiderRadars {
 public:
  // `rows`: records from which the noise is estimated. There are no radars if the response is
  // unknown, or if the inputs do not include the radar.
  WiderRadars(const Dataset& data, const Rows& rows, Inputs inputs);
  std::size_t size() const { return wider_.size(); }
  double times_wider(std::size_t k) const { return wider_[k].width_m() / own_.width_m(); }
  // Returns these records as if they were recorded with radar k and then converted to the response
  // of the training data: echoes lose detail, and the filter colours the noise.
  Dataset imitated(std::size_t k, const Dataset& from, const Rows& rows, Rng& rng) const;

 private:
  record::RadarResponse own_;
  std::vector<record::RadarResponse> wider_;
  RadarNoise noise_;
};

}  // namespace echofuse::recon

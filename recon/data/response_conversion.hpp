// SPDX-License-Identifier: MIT
// Converts the radar profiles of a run to the radar response of a model's training data. A run
// contains the response of its radar to a point target (acquire/measurement/response.hpp). The
// conversion is a linear filter. It is exact for incoherent echoes, because their powers add up;
// for coherent echoes it is correct on average.
#pragma once
#include <vector>

#include "acquire/measurement/response.hpp"
#include "drivers/core/random.hpp"
#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// Returns the 2n + 1 weights of a filter that converts samples of the response `own` to samples of
// the response `wanted`. Samples are `step_m` apart. The weights apply to the samples from n steps
// before to n steps after the output sample. The filter is a Wiener filter: the least-squares
// solution for noise 20 dB below the peak in each sample.
std::vector<double> response_filter(const record::RadarResponse& own,
                                    const record::RadarResponse& wanted, double step_m);

// Returns the widest radar response of the runs, because conversion to a wider response adds no
// noise. The result is unknown if no run includes its response.
record::RadarResponse widest_response(const Dataset& data);

// Filters the radar profiles and lags of each run that includes its radar response, and stores the
// new response in the run's Source. Does not change other runs, binned power, or the rows of a dead
// sensor. If `knows_any` is true (the model was trained for any response), responses much narrower
// than `wanted` are not converted either, because widening them would reduce the accuracy.
void bring_to_response(Dataset& data, const record::RadarResponse& wanted, bool knows_any = false);

// Returns those responses of the sweep windows cos^2, cos^4, cos^6 and cos^8 (Harris, Proc. IEEE
// 66, 1978) that are at least 5 % wider than `than`, with the narrowest first.
std::vector<record::RadarResponse> wider_responses(const record::RadarResponse& than);

// Standard deviations, in each bin, of the noise in the radar power and in each lag value.
// Estimated as the lower quartile over the bins, because bins with bodies vary more between
// records.
struct RadarNoise {
  RadarNoise(const Dataset& data, const Rows& rows);
  float power = 0;
  std::vector<float> lags;
};

// Makes the records resemble those of a radar with the response `wider` after conversion to the
// response `own`: echoes lose detail, and the filter colours the noise.
void imitate_brought(Dataset& data, const record::RadarResponse& own,
                     const record::RadarResponse& wider, const RadarNoise& noise, Rng& rng);

}  // namespace echofuse::recon

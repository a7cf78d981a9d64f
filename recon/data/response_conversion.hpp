// SPDX-License-Identifier: MIT
// Converts the profiles of a run to the radar response of a model's training. A run states its
// radar's response to a point (acquire/measurement/response.hpp). Powers of incoherent echoes add
// up, so a linear filter is exact; for coherent echoes it is right on average.
#pragma once
#include <vector>

#include "acquire/measurement/response.hpp"
#include "drivers/core/random.hpp"
#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// Returns 2n + 1 weights, from n steps before to n steps after. The filter converts samples of one
// response, `step_m` apart, to those of the other. Wiener filter: least squares with noise 20 dB
// below the peak in each sample.
std::vector<double> response_filter(const record::RadarResponse& own,
                                    const record::RadarResponse& wanted, double step_m);

// Widest response stated by a run of the data, because widening adds no noise; unknown if no run
// states one.
record::RadarResponse widest_response(const Dataset& data);

// Filters the radar's profiles and lags of each run with a stated response, and records the new one
// in the data's sources. Does not change runs without a stated response, binned power, and rows of
// a dead sensor. With knows_any it also keeps runs that are much narrower, because widening would
// reduce their accuracy.
void bring_to_response(Dataset& data, const record::RadarResponse& wanted, bool knows_any = false);

// Responses for the windows cos^2, cos^4, cos^6 and cos^8 over the sweep (Harris, Proc. IEEE 66,
// 1978) that are wider than this one; narrowest first.
std::vector<record::RadarResponse> wider_responses(const record::RadarResponse& than);

// Standard deviation of the radar's noise per bin: of its power, and of each value of its lags.
// Estimated from the quarter of bins with the smallest variation between records, which contain no
// bodies.
struct RadarNoise {
  RadarNoise(const Dataset& data, const Rows& rows);
  float power = 0;
  std::vector<float> lags;
};

// Changes records into those of a radar with a wider response, converted to the `own` one: echoes
// lose detail, and the filter colours the noise.
void imitate_brought(Dataset& data, const record::RadarResponse& own,
                     const record::RadarResponse& wider, const RadarNoise& noise, Rng& rng);

}  // namespace echofuse::recon

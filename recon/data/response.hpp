// SPDX-License-Identifier: MIT
// A run states its radar's range response to a point (acquire/measurement/response.hpp). This file
// brings the profiles of a run to the response of a model's training. In power, echoes that do not
// interfere add up, so one linear filter does it; of echoes that interfere it is right on average.
#pragma once
#include <vector>

#include "acquire/measurement/response.hpp"
#include "drivers/core/random.hpp"
#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// Returns 2n + 1 weights, from n steps before to n steps behind. The filter turns samples of one
// response, `step_m` apart, into those of the other. Wiener's filter: least squares with noise 20
// dB below the peak in each sample.
std::vector<double> response_filter(const record::RadarResponse& own,
                                    const record::RadarResponse& wanted, double step_m);

// Widest response that a run of the data states, because widening adds no noise; not known if no
// run states one.
record::RadarResponse widest_response(const Dataset& data);

// Filters the radar's profiles and lags of each run that states a response, and writes the wanted
// one into the data's sources. Unchanged are runs that state none, data of binned power and rows of
// a dead sensor. With knows_any a run much narrower than the wanted one is unchanged, too, because
// widening it costs more than it gains.
void bring_to_response(Dataset& data, const record::RadarResponse& wanted, bool knows_any = false);

// Responses to the windows cos^2, cos^4, cos^6 and cos^8 over the sweep (Harris, Proc. IEEE 66,
// 1978) that are wider than this one; narrowest first.
std::vector<record::RadarResponse> wider_responses(const record::RadarResponse& than);

// Standard deviation of the radar's noise in a bin: of its power, and of each value of its lags.
// Of the bins the quarter with the smallest scatter over the records counts, because bodies do not
// reach it.
struct RadarNoise {
  RadarNoise(const Dataset& data, const Rows& rows);
  float power = 0;
  std::vector<float> lags;
};

// Changes records into those of a radar with a wider response that were brought to their `own` one:
// the echoes lose detail, and the filter colours the noise.
void imitate_brought(Dataset& data, const record::RadarResponse& own,
                     const record::RadarResponse& wider, const RadarNoise& noise, Rng& rng);

}  // namespace echofuse::recon

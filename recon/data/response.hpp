// SPDX-License-Identifier: MIT
// A run states its radar's range response to a point (acquire/measurement/response.hpp). This file
// brings the profiles of a run to the response of a model's training. In power, echoes that do not
// interfere add up, so one linear filter does it; of echoes that interfere it is right on average.
#pragma once
#include <vector>

#include "acquire/measurement/response.hpp"
#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// It returns 2n + 1 weights, of the point n steps before to the point n steps behind. They turn
// samples of one response, `step_m` apart, into those of the other, as well as noise 20 dB below
// the peak in each sample permits (least squares with a penalty; Wiener's filter).
std::vector<double> response_filter(const record::RadarResponse& own,
                                    const record::RadarResponse& wanted, double step_m);

// It returns the widest response that a run of the data states, as a narrower one is brought to a
// wider one with less noise; not known if no run states one.
record::RadarResponse widest_response(const Dataset& data);

// It filters the radar's profiles and lags of each run that states a response, and writes the
// wanted one into the data's sources. Runs that state none stay as they are, and so do data of
// binned power. A dead sensor's row stays dead. If the model knows any response, a run much
// narrower than the wanted one stays, too: bringing it there would cost more than it gains.
void bring_to_response(Dataset& data, const record::RadarResponse& wanted, bool knows_any = false);

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
#include "recon/train.hpp"

namespace echofuse::recon {

TrainedModel train(const Dataset& data, const TrainOptions& options) {
  const Inputs inputs = inputs_of(options.inputs);
  const Split split = make_split(data.usable(inputs), options.split);
  TrainedModel model = fit_model(data, split, options.model, inputs, options.scaling, options.fit);
  model.split = options.split;
  return model;
}

}  // namespace echofuse::recon

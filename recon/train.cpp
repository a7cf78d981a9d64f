// SPDX-License-Identifier: MIT
#include "recon/train.hpp"

#include "recon/text.hpp"

namespace echofuse::recon {
namespace {

// Everything that a resumed training must have in common with the one that was stopped.
std::vector<std::pair<std::string, std::string>> settings_of(const Dataset& data,
                                                             const TrainOptions& o) {
  std::string hidden;
  for (const std::size_t n : o.fit.hidden) hidden += formatted(hidden.empty() ? "%zu" : ",%zu", n);
  return {{"records", std::to_string(data.size()) + formatted(" (checksum %08x)", data.hash)},
          {"radar bins", std::to_string(data.radar_axis.count)},
          {"--model", o.model},
          {"--inputs", o.inputs},
          {"--scaling", o.scaling},
          {"--hidden", hidden},
          {"--epochs", std::to_string(o.fit.epochs)},
          {"--batch", std::to_string(o.fit.batch)},
          {"--learning-rate", formatted("%.17g", o.fit.learning_rate)},
          {"--weight-decay", formatted("%.17g", o.fit.weight_decay)},
          {"--patience", std::to_string(o.fit.patience)},
          {"--seed", std::to_string(o.fit.seed)},
          {"--split", o.split.kind},
          {"--test-share", formatted("%.17g", o.split.test_share)},
          {"--validation-share", formatted("%.17g", o.split.validation_share)},
          {"--gap", std::to_string(o.split.gap)}};
}

}  // namespace

Rows rows_to_train(const Dataset& data, Inputs inputs) {
  const Rows rows = data.usable(inputs);
  for (const std::size_t row : rows) {
    const std::string fault = data.fault_of(row, inputs);
    if (fault.empty()) continue;
    std::size_t run = 0;
    while (row >= data.sources[run].first + data.sources[run].count) ++run;
    throw Error(ExitCode::failed, data.sources[run].path + ": record " +
                                      std::to_string(data.index[row]) + ": " + fault +
                                      ": a dead sensor, of which nothing can be learned");
  }
  return rows;
}

TrainedModel train(const Dataset& data, const TrainOptions& options) {
  const Inputs inputs = inputs_of(options.inputs);
  const Split split = make_split(rows_to_train(data, inputs), options.split);
  FitOptions fit = options.fit;
  if (!fit.checkpoint.path.empty()) fit.checkpoint.settings = settings_of(data, options);
  TrainedModel model = fit_model(data, split, options.model, inputs, options.scaling, fit);
  model.split = options.split;
  return model;
}

}  // namespace echofuse::recon

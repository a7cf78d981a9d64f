// SPDX-License-Identifier: MIT
// Plain network of Lai et al. (2024): concatenated inputs, two hidden layers, linear output,
// squared loss. Predicts the difference from the mean map, in units of the standard deviation of
// the maps.
#include "drivers/util/console.hpp"
#include "recon/models/fit_maps.hpp"

namespace echofuse::recon {
namespace {

class Mlp final : public Model {
 public:
  TrainingLog fit(const Samples& train, const Samples& validation,
                  const FitOptions& options) override {
    return fit_maps(regression_, train, validation, training_of(options), "depth map");
  }
  std::unique_ptr<Model> tuned(const Samples& train, const Tuning& tuning) const override {
    auto out = std::make_unique<Mlp>(*this);
    if (!tuning.networks_stay())
      out->regression_.tune({train.inputs, train.maps, train.rows},
                            training_of(tuning, train.rows.size()), "training");
    return out;
  }
  Matrix predict(const Matrix& inputs, SoftMaps*) const override {
    return regression_.predict(inputs);
  }
  Cost cost() const override { return regression_.cost(); }
  FitOptions sizes() const override { return {.hidden = regression_.hidden()}; }
  void archive(Archive archive, const Shape& shape) override {
    regression_.archive(archive, shape.inputs, shape.outputs);
  }

 private:
  Regression regression_;
};

}  // namespace

TrainingLog fit_maps(Regression& regression, const Samples& train, const Samples& validation,
                     const Training& training, const std::string& title) {
  Progress progress(title, training.epochs, training.quiet);
  const TrainingLog log = regression.fit(
      {train.inputs, train.maps, train.rows}, {validation.inputs, validation.maps, validation.rows},
      Spread::common, training, "training", [&](std::size_t epochs, double loss) {
        progress.update(epochs, "validation loss " + std::to_string(loss));
      });
  if (!log.interrupted)
    progress.update(training.epochs, "best epoch " + std::to_string(log.best_epoch));
  return log;
}

std::unique_ptr<Model> make_mlp() { return std::make_unique<Mlp>(); }

}  // namespace echofuse::recon

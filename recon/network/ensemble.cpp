// SPDX-License-Identifier: MIT
#include "recon/network/ensemble.hpp"

#include "drivers/util/console.hpp"

namespace echofuse::recon {

TrainingLog Ensemble::fit(const Examples& train, const Examples& validation, Spread spread,
                          Training training, std::size_t networks, const std::string& title) {
  TrainingLog log;
  networks_.clear();
  const std::size_t all = networks * training.epochs;
  Progress progress(title + " of the body", all, training.quiet);
  while (networks_.size() < networks && !log.interrupted) {
    const std::size_t before = networks_.size() * training.epochs;
    const std::string which =
        "network " + std::to_string(networks_.size() + 1) + " of " + std::to_string(networks);
    log = networks_.emplace_back().fit(
        train, validation, spread, training, title, [&](std::size_t epochs, double loss) {
          if (before + epochs < all)
            progress.update(before + epochs, which + ", validation loss " + std::to_string(loss));
        });
    training.seed = mix(training.seed);
  }
  if (!log.interrupted) progress.update(all, std::to_string(networks) + " networks");
  return log;
}

void Ensemble::correct(const Examples& train) {
  for (Regression& network : networks_) network.correct(train);
}

void Ensemble::tune(const Examples& train, Training training, const std::string& title) {
  for (Regression& network : networks_) {
    network.tune(train, training, title);
    training.seed = mix(training.seed);
  }
}

Matrix Ensemble::predict(const Matrix& inputs) const {
  Matrix sum = networks_.front().predict(inputs);
  for (std::size_t n = 1; n < networks_.size(); ++n) {
    const Matrix one = networks_[n].predict(inputs);
    for (std::size_t i = 0; i < sum.values.size(); ++i) sum.values[i] += one.values[i];
  }
  for (float& v : sum.values) v /= static_cast<float>(networks_.size());
  return sum;
}

Cost Ensemble::cost() const {
  Cost out;
  for (const Regression& network : networks_) out += network.cost();
  return out;
}

void Ensemble::archive(Archive archive, std::size_t inputs, std::size_t outputs) {
  std::size_t networks = networks_.size();
  archive.count("networks", networks, 1, 64);
  networks_.resize(networks);
  for (std::size_t n = 0; n < networks; ++n)
    networks_[n].archive(archive.in(std::to_string(n)), inputs, outputs);
}

}  // namespace echofuse::recon

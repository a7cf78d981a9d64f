// SPDX-License-Identifier: MIT
// Ensemble: mean of a few small, independently trained networks. Their errors differ where the
// records contain little information, so the mean has a smaller error. Source: Breiman, Machine
// Learning 24, 123, 1996.
#pragma once
#include <string>
#include <vector>

#include "recon/network/regression.hpp"

namespace echofuse::recon {

class Ensemble {
 public:
  // Fits each of the `networks` networks with Regression::fit, with a separate random stream.
  // Returns the training log of the last network.
  TrainingLog fit(const Examples& train, const Examples& validation, Spread spread,
                  Training training, std::size_t networks, const std::string& title);
  // correct() calls Regression::correct for each network, and tune() calls Regression::tune.
  void correct(const Examples& train);
  void tune(const Examples& train, Training training, const std::string& title);
  // Returns the outputs averaged over all networks, with one row for each row of `inputs`.
  Matrix predict(const Matrix& inputs) const;
  Cost cost() const;
  // Reads or writes the networks as groups "0", "1", ...
  void archive(Archive archive, std::size_t inputs, std::size_t outputs);

 private:
  std::vector<Regression> networks_;
};

}  // namespace echofuse::recon

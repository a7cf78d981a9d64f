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
  // Runs Regression::fit for `networks` networks with separate random streams. Returns the log of
  // the last one.
  TrainingLog fit(const Examples& train, const Examples& validation, Spread spread,
                  Training training, std::size_t networks, const std::string& title);
  // Run Regression::correct and Regression::tune for each network.
  void correct(const Examples& train);
  void tune(const Examples& train, Training training, const std::string& title);
  // Returns one row of outputs per row of `inputs`.
  Matrix predict(const Matrix& inputs) const;
  Cost cost() const;
  void archive(Archive archive, std::size_t inputs, std::size_t outputs);  // groups "0", "1", ...

 private:
  std::vector<Regression> networks_;
};

}  // namespace echofuse::recon

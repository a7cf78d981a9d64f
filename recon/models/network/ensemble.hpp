// SPDX-License-Identifier: MIT
// The mean of a few small networks, trained apart: their errors differ where the records say
// little, so that the mean errs less than each (Breiman, Machine Learning 24, 123, 1996).
#pragma once
#include <string>
#include <vector>

#include "recon/models/network/regression.hpp"

namespace echofuse::recon {

class Ensemble {
 public:
  // As Regression::fit, of so many networks, each with random numbers of its own. The log is of the
  // last one.
  TrainingLog fit(const Examples& train, const Examples& validation, Spread spread,
                  Training training, std::size_t networks, const std::string& title);
  // As Regression::tune, of each network.
  void tune(const Examples& train, Training training, const std::string& title);
  // Row i of `inputs` to row i of the answer, which has so many columns as the targets had.
  Matrix predict(const Matrix& inputs) const;
  Cost cost() const;
  void archive(Archive archive, std::size_t inputs, std::size_t outputs);  // "0", "1", ...

 private:
  std::vector<Regression> networks_;
};

}  // namespace echofuse::recon

// SPDX-License-Identifier: MIT
// An ensemble answers with the mean of a few small networks, trained apart. Their errors differ
// where the records say little, so the mean errs less than each. Source: Breiman, Machine Learning
// 24, 123, 1996.
#pragma once
#include <string>
#include <vector>

#include "recon/network/regression.hpp"

namespace echofuse::recon {

class Ensemble {
 public:
  // Runs Regression::fit for `networks` networks, each with random numbers of its own. The log is
  // that of the last one.
  TrainingLog fit(const Examples& train, const Examples& validation, Spread spread,
                  Training training, std::size_t networks, const std::string& title);
  // Run Regression::correct and Regression::tune for each network.
  void correct(const Examples& train);
  void tune(const Examples& train, Training training, const std::string& title);
  // Row i of `inputs` gives row i of the answer, which has as many columns as the targets had.
  Matrix predict(const Matrix& inputs) const;
  Cost cost() const;
  void archive(Archive archive, std::size_t inputs, std::size_t outputs);  // "0", "1", ...

 private:
  std::vector<Regression> networks_;
};

}  // namespace echofuse::recon

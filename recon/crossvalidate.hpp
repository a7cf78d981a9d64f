// SPDX-License-Identifier: MIT
// How well each kind of model does on a sequence of records: blocked cross-validation, in which no
// record is judged by a model that has seen its neighbours in time.
#pragma once
#include <string>
#include <vector>

#include "recon/evaluate.hpp"

namespace echofuse::recon {

struct CrossvalidateOptions {
  std::string inputs = "fused", scaling = "record";
  std::vector<std::string> models = {"mean", "nearest", "ridge", "mlp"};
  std::size_t folds = 6;
  std::size_t gap = 10;  // records between a fold and its training records
  FitOptions fit;
};

// One row a model. `published`, if it has records, holds another's reconstructions of the same
// records as its depth maps: they make a last row "published".
std::vector<ScoredRow> crossvalidate(const Dataset& data, const CrossvalidateOptions& options,
                                     const Dataset& published);

}  // namespace echofuse::recon

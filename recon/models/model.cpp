// SPDX-License-Identifier: MIT
#include "recon/models/model.hpp"

#include "drivers/core/exit_code.hpp"

namespace echofuse::recon {

std::unique_ptr<Model> make_model(const std::string& name) {
  if (name == "empty") return make_background();
  if (name == "mean") return make_mean();
  if (name == "nearest") return make_nearest();
  if (name == "ridge") return make_ridge();
  if (name == "mlp") return make_mlp();
  throw Error(ExitCode::usage,
              "model \"" + name + "\": expected empty, mean, nearest, ridge or mlp");
}

}  // namespace echofuse::recon

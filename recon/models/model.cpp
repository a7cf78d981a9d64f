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
  if (name == "silhouette") return make_silhouette();
  if (name == "factorised") return make_factorised();
  throw Error(ExitCode::usage, "model \"" + name +
                                   "\": expected empty, mean, nearest, ridge, mlp, silhouette or "
                                   "factorised");
}

bool wants_readings(const std::string& name) {
  return name == "silhouette" || name == "factorised";
}

}  // namespace echofuse::recon

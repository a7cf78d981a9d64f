// SPDX-License-Identifier: MIT
// Baselines that predict the same map for all inputs: the empty room and the mean training map.
#include <algorithm>

#include "recon/metrics/scene_model.hpp"
#include "recon/models/model.hpp"

namespace echofuse::recon {
namespace {

class Constant final : public Model {
 public:
  explicit Constant(bool mean) : mean_(mean) {}

  TrainingLog fit(const Samples& train, const Samples&, const FitOptions&) override {
    map_ = mean_ ? train.scene->mean_map : train.scene->background;
    return {};
  }
  Matrix predict(const Matrix& inputs, SoftMaps*) const override {
    Matrix out(inputs.rows, map_.size());
    for (std::size_t i = 0; i < out.rows; ++i)
      std::copy(map_.begin(), map_.end(), out.row(i).begin());
    return out;
  }
  Cost cost() const override { return {0, map_.size()}; }
  void archive(Archive archive, const Shape& shape) override {
    archive.values("map_m", map_, shape.outputs);
  }

 private:
  bool mean_;
  std::vector<float> map_;
};

}  // namespace

std::unique_ptr<Model> make_empty() { return std::make_unique<Constant>(false); }
std::unique_ptr<Model> make_mean() { return std::make_unique<Constant>(true); }

}  // namespace echofuse::recon

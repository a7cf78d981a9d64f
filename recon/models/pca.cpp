// SPDX-License-Identifier: MIT
// Predicts the coefficients of the strongest principal components of the training maps, instead of
// every pixel. The components form a fixed last layer, which is the largest layer of the model.
#include "recon/models/model.hpp"
#include "recon/numbers/components.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t max_maps = 3000;

class Pca final : public Model {
 public:
  explicit Pca(std::unique_ptr<Model> inner) : inner_(std::move(inner)) {}

  TrainingLog fit(const Samples& train, const Samples& validation,
                  const FitOptions& options) override {
    Rows some;
    const std::size_t stride = train.rows.size() / max_maps + 1;
    for (std::size_t i = 0; i < train.rows.size(); i += stride) some.push_back(train.rows[i]);
    components_ =
        principal_components(take_rows(train.maps, some), options.basis.value(), options.seed);
    const Matrix amounts = coordinates(components_, train.maps);
    return inner_->fit({train.inputs, amounts, train.rows},
                       {validation.inputs, amounts, validation.rows}, options);
  }
  // Keeps the components, because they do not contain the background, which differs between rooms.
  std::unique_ptr<Model> tuned(const Samples& train, const Tuning& tuning) const override {
    auto out = std::make_unique<Pca>(nullptr);
    out->components_ = components_;
    if (!tuning.networks_stay()) out->move_mean(predict(train.inputs, nullptr), train);
    const Matrix amounts = coordinates(out->components_, train.maps);
    out->inner_ = inner_->tuned({train.inputs, amounts, train.rows}, tuning);
    return out->inner_ ? std::move(out) : nullptr;
  }
  Matrix predict(const Matrix& inputs, SoftMaps*) const override {
    return from_coordinates(components_, inner_->predict(inputs));
  }
  Cost cost() const override {
    const Cost inner = inner_->cost();
    const std::size_t basis = components_.basis.values.size();
    return {inner.multiply_adds + basis, inner.parameters + basis + components_.mean.size()};
  }
  FitOptions sizes() const override {
    FitOptions out = inner_->sizes();
    out.basis = components_.basis.rows;
    return out;
  }
  void archive(Archive archive, const Shape& shape) override {
    recon::archive(archive.in("components"), components_, shape.outputs);
    inner_->archive(archive, {shape.inputs, components_.basis.rows, shape.grid});
  }

 private:
  void move_mean(const Matrix& found, const Samples& train) {
    const auto n = static_cast<float>(train.rows.size());
    const auto share = static_cast<float>(Tuning::shrinkage(train.rows.size())) / n;
    for (const std::size_t row : train.rows)
      for (std::size_t c = 0; c < found.cols; ++c)
        components_.mean[c] += share * (train.maps.row(row)[c] - found.row(row)[c]);
  }

  std::unique_ptr<Model> inner_;
  Components components_;
};

}  // namespace

// The network predicts the coefficients of the maps' principal components.
std::unique_ptr<Model> make_pca_mlp() { return std::make_unique<Pca>(kind_of("mlp").make()); }

}  // namespace echofuse::recon

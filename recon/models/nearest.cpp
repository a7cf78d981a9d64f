// SPDX-License-Identifier: MIT
// Nearest neighbour in the scaled inputs: what a look-up table of the training set can do.
#include <algorithm>
#include <limits>

#include "recon/models/blas.hpp"
#include "recon/models/model.hpp"

namespace echofuse::recon {
namespace {

class Nearest final : public Model {
 public:
  TrainingLog fit(const Samples& train, const Samples&, const FitOptions&) override {
    inputs_ = take_rows(train.inputs, train.rows);
    maps_ = take_rows(train.maps, train.rows);
    measure();
    return {};
  }
  Matrix predict(const Matrix& inputs) const override {
    // |x - t|^2 = |x|^2 - 2 x.t + |t|^2, and |x|^2 is the same for all t.
    Matrix score(inputs.rows, inputs_.rows), out(inputs.rows, maps_.cols);
    multiply({inputs.rows, inputs_.rows, inputs_.cols, Transpose::no, Transpose::yes, -2.f},
             inputs.values.data(), inputs_.values.data(), score.values.data());
    for (std::size_t i = 0; i < inputs.rows; ++i) {
      const auto nearest = maps_.row(nearest_of(score.row(i)));
      std::copy(nearest.begin(), nearest.end(), out.row(i).begin());
    }
    return out;
  }
  Cost cost() const override {
    return {inputs_.values.size(), inputs_.values.size() + maps_.values.size()};
  }
  void save(record::H5File& file) const override {
    file.write("model/inputs", inputs_.values, {inputs_.rows, inputs_.cols});
    file.write("model/maps_m", maps_.values, {maps_.rows, maps_.cols});
  }
  void load(const record::H5File& file) override {
    inputs_ = read_matrix(file, "model/inputs");
    maps_ = read_matrix(file, "model/maps_m");
    measure();
  }

 private:
  void measure() {
    squares_.assign(inputs_.rows, 0);
    for (std::size_t t = 0; t < inputs_.rows; ++t)
      for (const float v : inputs_.row(t)) squares_[t] += v * v;
  }
  std::size_t nearest_of(std::span<const float> score) const {
    std::size_t best = 0;
    float least = std::numeric_limits<float>::max();
    for (std::size_t t = 0; t < score.size(); ++t) {
      const float distance = score[t] + squares_[t];
      if (distance < least) least = distance, best = t;
    }
    return best;
  }

  Matrix inputs_, maps_;
  std::vector<float> squares_;
};

}  // namespace

std::unique_ptr<Model> make_nearest() { return std::make_unique<Nearest>(); }

}  // namespace echofuse::recon

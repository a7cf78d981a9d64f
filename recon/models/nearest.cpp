// SPDX-License-Identifier: MIT
// Finds the training records nearest to a record in the space of scaled inputs. Returns the
// weighted mean of their maps, or the map of the nearest record.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "recon/models/model.hpp"
#include "recon/numbers/row_product.hpp"

namespace echofuse::recon {
namespace {

class Nearest final : public Model {
 public:
  TrainingLog fit(const Samples& train, const Samples&, const FitOptions& options) override {
    inputs_ = take_rows(train.inputs, train.rows);
    maps_ = take_rows(train.maps, train.rows);
    neighbours_ = std::min(options.basis.value_or(1), inputs_.rows);
    measure();
    return {};
  }
  Matrix predict(const Matrix& inputs, SoftMaps*) const override {
    // Uses |x - t|^2 = |x|^2 - 2 x.t + |t|^2 and omits |x|^2, which is equal for all t.
    Matrix score(inputs.rows, inputs_.rows), out(inputs.rows, maps_.cols);
    add_row_products(inputs.rows, inputs_.rows, inputs_.cols, inputs.values.data(),
                     columns_.values.data(), score.values.data());
    for (std::size_t i = 0; i < inputs.rows; ++i) blend(score.row(i), out.row(i));
    return out;
  }
  Cost cost() const override {
    const std::size_t blended = neighbours_ > 1 ? neighbours_ * maps_.cols : 0;
    return {inputs_.values.size() + blended, inputs_.values.size() + maps_.values.size()};
  }
  void archive(Archive archive, const Shape& shape) override {
    archive.table("inputs", inputs_, Archive::any, shape.inputs);
    archive.table("maps_m", maps_, inputs_.rows, shape.outputs);
    archive.count("neighbours", neighbours_, 1, static_cast<std::int64_t>(maps_.rows));
    if (archive.reading()) measure();
  }

 private:
  void measure() {
    squares_.assign(inputs_.rows, 0);
    columns_ = Matrix(inputs_.cols, inputs_.rows);
    for (std::size_t t = 0; t < inputs_.rows; ++t)
      for (std::size_t c = 0; c < inputs_.cols; ++c) {
        const float v = columns_.row(c)[t] = inputs_.row(t)[c];
        squares_[t] += v * v;
      }
  }
  // Weights a neighbour by exp(-excess / width). `excess` is its squared distance minus that of the
  // nearest neighbour; `width` is a third of the mean excess. If `width` were the full mean excess,
  // 16 neighbours would reduce the IoU from .25 to .17.
  void blend(std::span<const float> score, std::span<float> map) const {
    const auto distance = [&](std::size_t t) { return squares_[t] - 2 * score[t]; };
    Rows order = all_rows(inputs_.rows);
    const auto end = order.begin() + static_cast<std::ptrdiff_t>(neighbours_);
    std::partial_sort(order.begin(), end, order.end(), [&](std::size_t a, std::size_t b) {
      return std::pair(distance(a), a) < std::pair(distance(b), b);
    });
    std::vector<float> farther, weights;
    for (auto t = order.begin(); t != end; ++t)
      farther.push_back(distance(*t) - distance(order.front()));
    const float excess = std::accumulate(farther.begin(), farther.end(), 0.f);
    const float width = std::max(excess / static_cast<float>(3 * neighbours_), 1e-30f);
    for (const float f : farther) weights.push_back(std::exp(-f / width));
    const float all = std::accumulate(weights.begin(), weights.end(), 0.f);
    for (std::size_t k = 0; k < neighbours_; ++k) {
      const auto from = maps_.row(order[k]);
      for (std::size_t p = 0; p < map.size(); ++p) map[p] += weights[k] / all * from[p];
    }
  }

  Matrix inputs_, maps_;
  Matrix columns_;  // transposed inputs_
  std::vector<float> squares_;
  std::size_t neighbours_ = 1;
};

}  // namespace

std::unique_ptr<Model> make_nearest() { return std::make_unique<Nearest>(); }

}  // namespace echofuse::recon

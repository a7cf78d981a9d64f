// SPDX-License-Identifier: MIT
// Tests that the map of a record does not depend on the records that share its batch, for every
// instruction set of this processor and every kind of model.
#include "recon/numbers/row_product.hpp"

#include <hwy/highway.h>

#include <bit>

#include "recon/numbers/parallel.hpp"
#include "world.hpp"

namespace {

template <class Work>
void with_each_instruction_set(const Work& work) {
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::GetChosenTarget().Update(target);
    INFO(hwy::TargetName(target));
    work();
  }
  hwy::GetChosenTarget().DeInit();  // lets Highway choose the best target again
}

bool same_bits(std::span<const float> a, std::span<const float> b) {
  return std::ranges::equal(a, b, {}, std::bit_cast<std::uint32_t, float>,
                            std::bit_cast<std::uint32_t, float>);
}

}  // namespace

TEST_CASE("a row of a product does not depend on the other rows, and equals the sum over k") {
  Rng rng = make_rng(11, 0);
  std::normal_distribution<float> normal;
  for (const auto& [m, n, k] : std::vector<std::array<std::size_t, 3>>{
           {1, 1, 1}, {2, 33, 5}, {4, 31, 257}, {13, 32, 8}, {57, 97, 300}, {257, 64, 512}}) {
    CAPTURE(m, n, k);
    std::vector<float> a(m * k), b(k * n), start(m * n);
    for (auto* values : {&a, &b, &start})
      for (float& v : *values) v = normal(rng);
    with_each_instruction_set([&, m = m, n = n, k = k] {
      std::vector<float> whole = start, rows = start;
      add_row_products(m, n, k, a.data(), b.data(), whole.data());
      for (std::size_t first = 0, count; first < m; first += count) {
        count = std::min<std::size_t>(1 + rng() % 16, m - first);
        add_row_products(count, n, k, a.data() + first * k, b.data(), rows.data() + first * n);
      }
      CHECK(same_bits(whole, rows));
      double largest = 0;
      for (std::size_t i = 0; i < m * n; ++i) {
        double sum = double{start[i]};
        for (std::size_t j = 0; j < k; ++j)
          sum += double{a[i / n * k + j]} * double{b[j * n + i % n]};
        largest = std::max(largest, std::abs(sum - double{whole[i]}));
      }
      CHECK(largest < 2e-6 * static_cast<double>(k + 10));
    });
  }
}

TEST_CASE("the map of a record is the same bit for bit in a batch of any size") {
  const Dataset data = load_plates(257);
  Rng rng = make_rng(12, 0);
  for (const std::string kind : {"mean-shape", "factorised-4", "ridge", "pca-mlp-4-9", "mlp-9-17",
                                 "mlp-mask-9-17", "nearest-3"}) {
    CAPTURE(kind);
    const TrainedModel model = trained_model(kind, 257, {"--epochs", "2"});
    const auto of = [&](const Rows& rows) {
      return predict(model, data, rows, fullest_detail(model));
    };
    with_each_instruction_set([&] {
      const Prediction whole = of(all_rows(data.size()));
      for (const std::size_t size :
           {std::size_t{1}, std::size_t{2}, std::size_t{4}, std::size_t{1 + rng() % 257}}) {
        CAPTURE(size);
        const std::size_t first = rng() % (data.size() - size + 1);
        set_threads(static_cast<int>(1 + rng() % 3));
        Rows rows(size);
        std::iota(rows.begin(), rows.end(), first);
        const Prediction part = of(rows);
        const auto rows_of = [&](const Matrix& table) {
          return std::span(table.values).subspan(first * table.cols, size * table.cols);
        };
        CHECK(same_bits(part.maps.values, rows_of(whole.maps)));
        if (whole.deviation.rows == 0) continue;
        CHECK(same_bits(part.deviation.values, rows_of(whole.deviation)));
        CHECK(same_bits(part.mean.values, rows_of(whole.mean)));
        // Intervals of maps without a body are NaN.
        for (std::size_t i = 0; i < size; ++i)
          CHECK(std::bit_cast<std::uint64_t>(part.uncertainties[i].lateral_interval_90_m) ==
                std::bit_cast<std::uint64_t>(whole.uncertainties[first + i].lateral_interval_90_m));
      }
      set_threads(0);
    });
  }
}

// SPDX-License-Identifier: MIT
// One model for the records of many laboratories, which takes what they have in common.
#include "recon/estimator/run_context.hpp"

#include <algorithm>
#include <cstdlib>

#include "recon/estimator/tune.hpp"
#include "recon/uncertainty/domain_shift.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

namespace {

constexpr std::size_t laboratories = 50;

// Each laboratory's bodies are as deep as its number says, so that the radar sees them wider.
Dataset plates(std::int64_t count, std::uint64_t seed, std::size_t of_laboratories) {
  const Folder dir;
  write_run(dir / "run", count, seed, [&](record::FusedRecord& r) {
    const auto laboratory = static_cast<std::size_t>(r.index) % std::max(of_laboratories, 1ul);
    const float share = static_cast<float>(laboratory) / laboratories;
    for (std::size_t i = r.radar.size() - 1; i > 0; --i) r.radar[i] += share * r.radar[i - 1];
  });
  Dataset data = load({dir / "run"});
  data.sources.front().laboratories = of_laboratories;
  return data;
}

struct Many {
  Dataset data = plates(900, 1, laboratories);
  Preprocessing preprocessing{data, all_rows(data.size()), Inputs::fused, {}, true};
};

const Many& many() {
  static const Many out;
  return out;
}

TrainedModel trained(const Dataset& data) {
  TrainOptions options;
  options.model = "silhouette", options.uncertainty = false;
  options.fit.quiet = true, options.fit.epochs = 3;
  return train(data, options);
}

}  // namespace

TEST_CASE("each record of many laboratories is trained with what its laboratory shows, or with 0") {
  const Matrix& contexts = many().preprocessing.contexts;
  REQUIRE(contexts.rows == 900);
  CHECK(contexts.cols == many().preprocessing.context.size());
  int unknown = 0;
  double first = 0, last = 0;  // the radar's width, of narrow and wide laboratories
  const std::size_t width = columns_of_shape(many().preprocessing.contexts.cols - 3)[1];
  for (std::size_t i = 0; i < contexts.rows; ++i) {
    const auto row = contexts.row(i);
    unknown += std::ranges::all_of(row, [](float v) { return v == 0; });
    for (const float v : row) CHECK(std::abs(v) <= 2.5f);
    if (i % laboratories < 10) first += double{row[width]};
    if (i % laboratories >= 40) last += double{row[width]};
  }
  CHECK(unknown > 900 * 0.2);
  CHECK(unknown < 900 * 0.4);
  CHECK(first < -50);
  CHECK(last > 20);
}

TEST_CASE("runs of one laboratory, or of few, have no context") {
  CHECK(laboratories_of(plates(60, 1, 0), all_rows(60)).empty());
  CHECK(laboratories_of(plates(60, 1, 6), all_rows(60)).empty());
  CHECK(laboratories_of(many().data, all_rows(300)).empty());  // 6 records each
  CHECK(trained(plates(60, 1, 0)).context.size() == 0);
}

TEST_CASE("a model of many laboratories learns the context of those that it is tuned to") {
  const TrainedModel model = trained(many().data);
  CHECK(model.context.size() == many().preprocessing.context.size());
  const Dataset room = plates(20, 2, 1);
  const Rows rows = all_rows(room.size());
  const auto contexts = [&](const TrainedModel& m) {
    const Matrix inputs = m.inputs(room, {0}, m.align(room, {0}, false));
    return std::vector<float>(inputs.values.begin(),
                              inputs.values.begin() + std::ptrdiff_t(m.context.size()));
  };
  CHECK(contexts(model) == std::vector<float>(model.context.size(), 0.f));
  TuneOptions options;
  options.split.test_share = options.split.validation_share = 0;
  options.only = "the room learnt";
  const TrainedModel tuned = tune(model, room, options).model;
  RunContext learnt = model.context;
  learnt.learn(tuned.alignment, room, tuned.align(room, rows, false), rows, Inputs::fused);
  const Matrix known = learnt.before(Matrix(1, 0));
  CHECK(std::ranges::equal(contexts(tuned), known.values));
  CHECK(contexts(tuned) != contexts(model));
  const Folder dir;
  save_model(tuned, dir / "m");
  CHECK(load_model(dir / "m").predict(room, {3}).values == tuned.predict(room, {3}).values);
}

TEST_CASE("a simulated run of many laboratories says so") {
  const Folder dir;
  const std::string command = test::bin_dir + "/echofuse-sim dataset -q --out " + (dir / "run") +
                              " --records 6 --twin default --laboratories 3";
  REQUIRE(std::system(command.c_str()) == 0);
  CHECK(load({dir / "run"}).sources.front().laboratories == 3);
}

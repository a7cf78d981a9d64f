// SPDX-License-Identifier: MIT
// Tests training with several threads, several runs, or dead sensors.
#include <sched.h>

#include "drivers/util/program.hpp"
#include "recon/numbers/parallel.hpp"
#include "world.hpp"

TEST_CASE("training gives the same model bit for bit for any number of threads, but not any seed") {
  const Dataset data = load_plates(150);
  for (const std::string name : {"mlp", "ridge"}) {
    CAPTURE(name);
    TrainOptions options = quiet_options(name, 3);
    const auto result = [&](int threads) {
      set_threads(threads);
      const TrainedModel model = train(data, options);
      const TrainingLog& log = model.first().log;
      return std::tuple(log.loss, log.validation_loss, log.best_epoch,
                        model.predict(data, {0, 1, 50}).values);
    };
    const auto one = result(1);
    CHECK(one == result(2));
    CHECK(one == result(3));
    options.fit.seed = 5;
    CHECK((one == result(1)) == (name == "ridge"));
  }
  set_threads(0);
}

TEST_CASE("training gives the records of all runs the same weight") {
  const Folder dir;
  a_run(60).write(dir / "a");
  a_run(20, 2, [](FusedRecord& r) { std::ranges::fill(depth_mm(r), 0); }).write(dir / "b");
  TrainOptions options = quiet_options("mean");
  options.split.test_share = 0, options.split.validation_share = 0.25;
  const Dataset both = load({dir / "a", dir / "b"});
  const TrainedModel model = train(both, options);
  const Rows held = model.rows_of(both, Subset::validation);
  CHECK(held.size() == 20);
  CHECK((held.front() < 60 && held.back() >= 60));
  double sum = 0;
  const Rows trained = model.rows_of(both, Subset::train);
  for (const std::size_t row : trained) sum += double{depth_maps(both).row(row)[0]};
  CHECK(model.predict(both, {0}).values[0] ==
        Approx(sum / static_cast<double>(trained.size())).epsilon(1e-4));
}

TEST_CASE("models that use no sensor inputs have no uncertainty and no outlier detection") {
  const Dataset data = load_plates(120);
  for (const std::string name : {"mean", "empty", "ridge"}) {
    CAPTURE(name);
    TrainOptions options = quiet_options(name);
    options.uncertainty = true;
    const TrainedModel model = train(data, options);
    const Estimator& e = model.first();
    for (const bool known : {e.uncertainty.has_value(), e.domain.known(), e.alignment.known()})
      CHECK(known == (name == "ridge"));
  }
}

TEST_CASE("the number of usable cores follows the CPU affinity of the process") {
  cpu_set_t before, one;
  REQUIRE(::sched_getaffinity(0, sizeof before, &before) == 0);
  CHECK(usable_cores() == static_cast<unsigned>(CPU_COUNT(&before)));
  CPU_ZERO(&one);
  for (std::size_t cpu = 0; CPU_COUNT(&one) == 0; ++cpu)
    if (CPU_ISSET(cpu, &before)) CPU_SET(cpu, &one);
  REQUIRE(::sched_setaffinity(0, sizeof one, &one) == 0);
  CHECK(usable_cores() == 1);
  ::sched_setaffinity(0, sizeof before, &before);
}

TEST_CASE("each work item is computed exactly once for any number of threads") {
  for (const int threads : {1, 2, 5}) {
    set_threads(threads);
    for (const std::size_t parts : {0u, 1u, 2u, 7u, 1000u}) {
      std::vector<int> seen(parts);
      for (int i = 0; i < 50; ++i) for_each_part(parts, [&](std::size_t k) { ++seen[k]; });
      CHECK(seen == std::vector<int>(parts, 50));
    }
  }
  set_threads(0);
}

// SPDX-License-Identifier: MIT
// Tests training with several threads, several runs, or dead sensors.
#include <sched.h>

#include "drivers/util/program.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/train/train.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::test;

namespace {

void check_same(const TrainedModel& a, const TrainedModel& b, const Dataset& data) {
  CHECK(a.first().log.loss == b.first().log.loss);
  CHECK(a.first().log.validation_loss == b.first().log.validation_loss);
  CHECK(a.first().log.best_epoch == b.first().log.best_epoch);
  CHECK(a.predict(data, {0, 1, 50}).values == b.predict(data, {0, 1, 50}).values);
}

}  // namespace

TEST_CASE("training with one, two or three threads gives the same model bit for bit") {
  const Folder dir;
  a_run(150).write(dir / "run");
  const Dataset data = load({dir / "run"});
  for (const std::string name : {"mlp", "ridge"}) {
    CAPTURE(name);
    TrainOptions options;
    options.uncertainty = false;
    options.model = name;
    options.fit.epochs = 3, options.fit.quiet = true;
    const auto with = [&](int threads) {
      set_threads(threads);
      return train(data, options);
    };
    const TrainedModel one = with(1);
    check_same(one, with(2), data);
    check_same(one, with(3), data);
  }
  set_threads(0);
}

TEST_CASE("training gives the records of all runs the same weight") {
  const Folder dir;
  a_run(60).write(dir / "a");
  a_run(20, 2, [](FusedRecord& r) {
    for (auto& mm : depth_mm(r)) mm = 0;
  }).write(dir / "b");
  TrainOptions options;
  options.model = "mean", options.fit.quiet = true, options.split.test_share = 0;
  options.split.validation_share = 0.25;
  const Dataset both = load({dir / "a", dir / "b"});
  const TrainedModel model = train(both, options);
  const Rows held = model.rows_of(both, Subset::validation);
  CHECK(held.size() == 20);
  CHECK(held.front() < 60);
  CHECK(held.back() >= 60);
  double sum = 0;
  const Rows trained = model.rows_of(both, Subset::train);
  for (const std::size_t row : trained) sum += double{depth_maps(both).row(row)[0]};
  CHECK(model.predict(both, {0}).values[0] ==
        Approx(sum / static_cast<double>(trained.size())).epsilon(1e-4));
  for (const char* gone : {"weights=1,1", "validate_on=1", "histogram_m=0.9"}) {
    const Outcome o = recon_program("train " + (dir / "a") + " --out " + (dir / "m") + " --set " +
                                    std::string(gone));
    CHECK(o.code == 3);
    CHECK_THAT(o.text, Catch::Contains("unknown key"));
  }
}

TEST_CASE("models that use no sensor inputs have no uncertainty and no outlier detection") {
  const Dataset data = load_plates(120);
  for (const std::string name : {"mean", "empty", "ridge"}) {
    CAPTURE(name);
    TrainOptions options;
    options.model = name, options.fit.quiet = true;
    const TrainedModel model = train(data, options);
    const bool takes_sensors = name == "ridge";
    CHECK(model.first().uncertainty.has_value() == takes_sensors);
    CHECK(model.first().domain.known() == takes_sensors);
    CHECK(model.first().alignment.known() == takes_sensors);
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

TEST_CASE("training refuses a run with a dead sensor and names the first affected record") {
  const Folder dir;
  a_run(20).write(dir / "good");
  a_run(20, 2, [](FusedRecord& r) {
    if (r.index >= 9 && r.index < 14) std::fill(counts(r).begin(), counts(r).end(), 4u);
  }).write(dir / "dead");
  const std::string command =
      "train -q --model ridge " + (dir / "good") + " " + (dir / "dead") + " --out " + (dir / "m");
  for (const std::string inputs : {"fused", "spd"}) {
    const Outcome o = recon_program(command + " --inputs " + inputs);
    CHECK(o.code == 1);
    CHECK_THAT(o.text, Catch::Contains(dir / "dead: record 9: spd is the same in every bin"));
  }
  CHECK(recon_program(command + " --inputs radar").code == 0);
}

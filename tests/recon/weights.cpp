// SPDX-License-Identifier: MIT
// Several runs in one training: how much each counts, and which stands for the use.
#include "recon/train/train.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

TEST_CASE("validation records are those of the runs that stand for the use, a fifth at most") {
  SplitOptions options;
  options.test_share = 0;
  options.validate_on = {90, 91, 92, 93, 94, 95, 96, 97, 98, 99};
  for (const char* kind : {"random", "blocked"}) {
    options.kind = kind, options.gap = 1, options.validation_share = 0.3;
    const Split split = make_split(all_rows(100), options);
    CHECK(split.validation.size() == 2);
    CHECK(split.validation.front() >= 90);
    CHECK(split.train.size() == (options.kind == "random" ? 98 : 97));
  }
}

TEST_CASE("a run that counts more moves the model towards it") {
  const Folder dir;
  write_run(dir / "a", 200);
  write_run(dir / "b", 20, 2, [](record::FusedRecord& r) {
    for (auto& mm : r.depth_mm) mm = 0;
  });
  const Dataset both = load({dir / "a", dir / "b"});
  const auto mean_of = [&](const std::vector<double>& weights) {
    TrainOptions options;
    options.model = "mean", options.fit.quiet = true;
    options.weights = weights;
    const TrainedModel model = train(both, options);
    double sum = 0;
    for (const float v : model.predict(both, {0}).values) sum += double{v};
    return sum;
  };
  CHECK(mean_of({1, 10}) == Approx(mean_of({}) * 220 / 400).epsilon(0.1));
  CHECK(mean_of({0.5, 0}) == Approx(mean_of({}) * 220 / 200).epsilon(0.1));
  const std::string train = "train -q --model mean --out " + (dir / "m") + " ";
  const std::string runs = (dir / "a") + " " + (dir / "b");
  CHECK_THAT(recon_program(train + runs + " --set weights=1").text,
             Catch::Contains("weights: 1 numbers for 2 runs"));
  CHECK_THAT(recon_program(train + runs + " --set validate_on=3").text,
             Catch::Contains("validate_on 3: there are 2 runs"));
  CHECK(recon_program(train + runs + " --set weights=1,20 --set validate_on=1,2").code == 0);
}

TEST_CASE(
    "few records that are unlike the others of a training count more, unless told otherwise") {
  const Folder dir;
  write_run(dir / "others", 160);
  write_run(dir / "alike", 40, 2);
  write_run(dir / "unlike", 40, 2,
            [](record::FusedRecord& r) {  // an impulse response as wide as a body
              const auto narrow = r.spd;
              for (std::size_t i = 6; i + 6 < r.spd.size(); ++i)
                r.spd[i] =
                    (narrow[i - 6] + narrow[i - 3] + narrow[i] + narrow[i + 3] + narrow[i + 6]) / 5;
            });
  const auto said_of = [&](const std::string& run, const std::string& options = {}) {
    std::filesystem::remove(dir / "m");
    return recon_program("train --model silhouette --set fallback=false --epochs 2 --out " +
                         (dir / "m") + " " + (dir / "others") + " " + (dir / run) + options)
        .text;
  };
  CHECK_THAT(said_of("unlike"), Catch::Contains("unlike the others (p ") &&
                                    Catch::Contains("each of their records counts 2."));
  CHECK_THAT(said_of("unlike", " --set weights=1,1"), !Catch::Contains("unlike the others"));
  CHECK_THAT(said_of("alike"), !Catch::Contains("unlike the others"));
}

// SPDX-License-Identifier: MIT
#include "recon/estimator/learning_curve.hpp"

#include <chrono>
#include <future>
#include <thread>

#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

TEST_CASE("a learning curve goes on as it began") {
  CHECK(learning_steps(9).empty());
  CHECK(learning_steps(130) == std::vector<std::size_t>{10, 20, 50, 100, 130});
  std::vector<LearningPoint> curve;
  CHECK_FALSE(forecast_of(curve));
  for (const std::size_t n : {20, 50, 100}) {
    const double iou = 0.6 - 0.8 / std::sqrt(static_cast<double>(n));
    curve.push_back({n, "tuned", {iou, 0.01, n}, {}});
  }
  REQUIRE(forecast_of(curve));
  CHECK(forecast_of(curve)->limit == Approx(0.6));
  CHECK(forecast_of(curve)->slope == Approx(0.8));
  CHECK(advice(curve) == "another 100 records: IoU +0.023; go on\n");
  for (LearningPoint& p : curve) p.iou.mean = 0.5 + 0.1 / static_cast<double>(p.records);
  CHECK(advice(curve) == "another 100 records: IoU +0.000, less than it is uncertain by (0.010)\n");
}

TEST_CASE("learn prints the curve of a run, also while it is being recorded") {
  const Folder dir;
  write_run(dir / "old", 200);
  write_run(dir / "new", 25, 2);
  REQUIRE(recon_program("train -q --no-fallback --model silhouette --epochs 20 " + (dir / "old") +
                        " --out " + (dir / "m"))
              .code == 0);
  const std::string learn = "learn --from " + (dir / "m") + " ";
  const Outcome o = recon_program(learn + (dir / "new"));
  CAPTURE(o.text);
  CHECK(o.code == 0);
  for (const char* line :
       {"\n      10  ", "\n      20  ", "\n      25  ", "another 100 records: IoU"})
    CHECK_THAT(o.text, Catch::Contains(line));
  CHECK_THAT(recon_program(learn + "--watch " + (dir / "new")).text,
             Catch::Contains("\n      25  "));
  write_run(dir / "few", 5, 2);
  CHECK_THAT(recon_program(learn + (dir / "few")).text,
             Catch::Contains("5 usable records; at least 10"));
}

TEST_CASE("learn follows a run that is being recorded until it is closed") {
  const Folder dir;
  write_run(dir / "old", 200);
  REQUIRE(recon_program("train -q --no-fallback --model silhouette --epochs 5 " + (dir / "old") +
                        " --out " + (dir / "m"))
              .code == 0);
  record::RunWriter run(dir / "live", {});
  for (const Axis& axis : {spd_axis(), radar_axis(), record::MapGrid{}.x(), record::MapGrid{}.y()})
    run.put_axis(axis);
  Rng rng = make_rng(1, 1);
  std::uniform_real_distribution<double> x(-1, 1), z(3, 4);
  const auto record = [&](std::int64_t from, std::int64_t until) {
    for (std::int64_t i = from; i < until; ++i) {
      const double at = x(rng);
      run.append(plate_record(i, at, z(rng), rng));
    }
  };
  record(0, 5);
  auto learnt = std::async(std::launch::async, [&] {
    return recon_program("learn --watch --from " + (dir / "m") + " " + (dir / "live") + " | tee " +
                         (dir / "told"));
  });
  // It has told of the first ten before the run goes on.
  record(5, 12);
  for (int i = 0; i < 600 && contents(dir / "told").find("\n      10  ") == std::string::npos; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  CHECK_THAT(contents(dir / "told"), Catch::Contains("\n      10  "));
  CHECK_THAT(contents(dir / "told"), !Catch::Contains("\n      20  "));
  record(12, 23);
  run.close("complete");
  const std::string text = learnt.get().text;
  CAPTURE(text);
  for (const char* line : {"\n      20  ", "\n      23  ", "another 100 records: IoU"})
    CHECK_THAT(text, Catch::Contains(line));
}

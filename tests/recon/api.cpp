// SPDX-License-Identifier: MIT
// Compares the public C++ interface (recon/include/echofuse) with the internal readers and models.
#include <echofuse/predict.hpp>
#include <echofuse/version.hpp>
#include <thread>

#include "recon/predict/predict.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::test;

namespace {

std::string trained(const Folder& dir, const std::string& model) {
  a_run(80).write(dir / "train");
  const Outcome o = recon_program("train -q --set fallback=false --model " + model + " " +
                                  (dir / "train") + " --out " + (dir / "m"));
  INFO(o.text);
  REQUIRE(o.code == 0);
  return dir / "m";
}

}  // namespace

TEST_CASE("records read through the API contain the values of the run file") {
  const Folder dir;
  a_run(3, 1, [](FusedRecord& r) {
    if (r.index != 1) return;
    r.valid.erase(Sensor::spd), counts(r).clear();
    set_verdict(r, Sensor::spd, "missing: no tags");
  }).write(dir / "run");
  const Run run(dir / "run");
  const record::RunReader reader(dir / "run");
  CHECK(run.facts().uuid == reader.info().uuid);
  CHECK(run.facts().status == "complete");
  CHECK(run.count() == 3);
  CHECK(run.zones() == 1);
  CHECK(run.axis("radar")->unit == "m");
  CHECK(run.axis("spd")->at(2) == spd_axis().at(2));
  CHECK_FALSE(run.axis("nonsense"));
  const record::FusedRecord stored = reader.read(2);
  const Record record = run.read(2);
  CHECK(std::ranges::equal(record.counts(), counts(stored)));
  CHECK(std::ranges::equal(record.power(), power(stored)));
  CHECK(record.depth_m().size() == run.grid().pixels());
  CHECK(record.depth_m()[32 * 64] == float(depth_mm(stored)[32 * 64]) / 1000);
  CHECK(record.label() == stored.label);
  CHECK(record.camera().valid);
  const Axis x = record::MapGrid{}.x(), y = record::MapGrid{}.y();
  CHECK(run.grid().x(5) == Approx(x.at(5)));
  CHECK(run.grid().y(5) == Approx(y.at(5)));
  std::vector<std::int64_t> seen;
  run.for_each([&](const Record& r) { return seen.push_back(r.index()), r.index() < 1; });
  CHECK(seen == std::vector<std::int64_t>{0, 1});
  const Record missing = run.read(1);
  CHECK(missing.counts().empty());
  CHECK_FALSE(missing.spd().valid);
  CHECK(missing.spd().verdict == "missing: no tags");
}

TEST_CASE("the API predicts the same depth map as the model, from a record or from arrays") {
  const Folder dir;
  const Model model(trained(dir, "mean-shape"));
  const recon::TrainedModel whole = recon::load_model(dir / "m");
  a_run(4, 2).write(dir / "fresh");
  const Run run(dir / "fresh");
  const recon::Records records =
      recon::prepare_records(whole, recon::load_recorded({dir / "fresh"}));
  CHECK(model.name() == "mean-shape");
  CHECK(model.inputs() == "fused");
  CHECK(model.calibrated() == whole->uncertainty.has_value());
  CHECK(model.spd_axis().count == 30);
  CHECK(model.grid().pixels() == 64 * 64);
  for (std::int64_t i = 0; i < run.count(); ++i) {
    const DepthMap map = predict(model, run, i);
    const auto row = static_cast<std::size_t>(i);
    const recon::Matrix maps = whole.predict(records.data, {row});
    CHECK(map.depth_m == recon::thresholded_map(maps.row(0), whole->scene));
    REQUIRE(map.body);
    CHECK(map.body->z_m == Approx(recon::body_place(maps.row(0), whole->scene).z_m));
    CHECK(map.deviation_m.size() == (model.calibrated() ? 64u * 64 : 0u));
    const Record record = run.read(i);
    const std::vector<float> counts(record.counts().begin(), record.counts().end());
    CHECK(predict(model, counts, record.power()).depth_m == map.depth_m);
  }
}

TEST_CASE("the API predicts the same depth map from the arrays of three zones as from the record") {
  const Folder dir;
  const Zones three{{-0.2, 0.05, 0.15, 0}, {0, -0.05, 0.25, 0}, {0.2, 0, 0.2, 0}};
  a_run(80, 1).zones(three).write(dir / "train"), a_run(4, 2).zones(three).write(dir / "fresh");
  const Outcome o = recon_program("train -q --set fallback=false --epochs 3 --model factorised-4 " +
                                  (dir / "train") + " --out " + (dir / "m"));
  INFO(o.text);
  REQUIRE(o.code == 0);
  const Model model(dir / "m");
  CHECK(model.zones() == 3);
  const Run run(dir / "fresh");
  for (std::int64_t i = 0; i < run.count(); ++i) {
    const Record record = run.read(i);
    const std::vector<float> counts(record.counts().begin(), record.counts().end());
    REQUIRE(counts.size() == 90);
    const DepthMap map = predict(model, run, i), of_arrays = predict(model, counts, record.power());
    REQUIRE(map.fault.empty());
    CHECK(of_arrays.depth_m == map.depth_m);
    CHECK(of_arrays.deviation_m == map.deviation_m);
  }
}

TEST_CASE("the API returns an error message instead of a map if a sensor is missing") {
  const Folder dir;
  const Model model(trained(dir, "mean-shape"));
  a_run(1, 2, [](FusedRecord& r) {
    r.valid.erase(Sensor::radar), power(r).clear();
  }).write(dir / "fresh");
  const DepthMap map = predict(model, Run(dir / "fresh"), 0);
  CHECK_THAT(map.fault, Catch::Contains("radar"));
  CHECK(map.depth_m.empty());
  CHECK(predict(model, std::vector<float>(30, 5), {}).fault == map.fault);
  CHECK_THAT(predict(model, Run(dir / "fresh"), 7).fault, Catch::Contains("cannot read"));
}

TEST_CASE("the API refuses invalid files and input values and states the reason") {
  const Folder dir;
  CHECK_THAT(error_of([&] { Run(dir / "none"); }), Catch::Contains("none"));
  CHECK_THAT(error_of([&] { Model(dir / "none"); }), Catch::Contains("expected a model file"));
  const Model model(trained(dir, "ridge"));
  const std::vector<float> power(24, 1);
  CHECK_THAT(error_of([&] { predict(model, std::vector<float>(29), power); }),
             Catch::Contains("counts: 29 values; the model expects 30 finite values"));
  const auto counts_with = [](float value) {
    std::vector<float> out(30, 5);
    out[7] = value;
    return out;
  };
  const std::pair<float, std::string> wrong[] = {{NAN, "nan"}, {INFINITY, "inf"}, {-1.0F, "-1"}};
  for (const auto& [value, text] : wrong)
    CHECK(error_of([&] { predict(model, counts_with(value), power); }) ==
          "counts: value 7 is " + text + "; the model expects 30 finite values of at least 0");
  CHECK(error_of([&] { predict(model, counts_with(9), std::vector<float>(24, -INFINITY)); }) ==
        "power: value 0 is -inf; the model expects 24 finite values");
  CHECK_THAT(error_of([&] { Run(dir / "train").read(80); }), Catch::Contains("no record 80"));
  CHECK(std::string(version()).find('.') != std::string::npos);
}

TEST_CASE("follow() visits the records of a growing run until it is closed") {
  const Folder dir;
  Rng rng = make_rng(1, 1);
  std::atomic<std::int64_t> seen = 0;
  const auto writer = a_run(0).open(dir / "run");
  std::vector<std::int64_t> indices;
  std::thread reader([&] {
    follow(dir / "run", [&](const Run& run, const Record& record) {
      indices.push_back(record.index());
      return run.count() > record.index() && ++seen > 0;
    });
  });
  for (std::int64_t i = 0; i < 3; ++i) {
    writer->append(plate_record(i, 0, 3, rng));
    for (int wait = 0; wait < 2000 && seen <= i; ++wait)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  CHECK(seen == 3);
  writer->close("complete");
  reader.join();
  CHECK(indices == std::vector<std::int64_t>{0, 1, 2});
  int visits = 0;
  follow(dir / "run", [&](const Run&, const Record&) { return ++visits < 2; });
  CHECK(visits == 2);
  follow(
      dir / "run", [&](const Run&, const Record&) { return ++visits, true; }, 0,
      [] { return false; });
  CHECK(visits == 2);
}

TEST_CASE("the API throws on a damaged record, or skips it if an error handler is given") {
  const Folder dir;
  a_run(4).write(dir / "run");
  for (const std::int64_t index : {1, 3})
    damage(dir / "run", "histogram of one byte in record ?1", {index});
  std::vector<std::int64_t> seen, bad;
  const auto on_damaged = [&](std::int64_t index, const std::string& fault) {
    CHECK_FALSE(fault.empty());
    bad.push_back(index);
  };
  const auto visit = [&](const Record& record) { return seen.push_back(record.index()), true; };
  const auto visit_live = [&](const Run&, const Record& record) { return visit(record); };
  SECTION("reading a closed run skips damaged records") {
    Run(dir / "run").for_each(visit, 0, on_damaged);
  }
  SECTION("following a run skips damaged records") {
    follow(dir / "run", visit_live, 0, {}, on_damaged);
  }
  CHECK(seen == std::vector<std::int64_t>{0, 2});
  CHECK(bad == std::vector<std::int64_t>{1, 3});
  CHECK_THAT(error_of([&] { Run(dir / "run").for_each(visit); }), Catch::Contains("record 1: "));
  CHECK_THAT(error_of([&] { follow(dir / "run", visit_live); }), Catch::Contains("record 1: "));
}

// SPDX-License-Identifier: MIT
// Compares the public C++ interface (recon/include/echofuse) with the internal readers and models.
#include <echofuse/predict.hpp>
#include <echofuse/version.hpp>

#include "world.hpp"

namespace {

// Returns the exception that `body` throws.
template <class Body>
Exception thrown_by(const Body& body) {
  try {
    body();
  } catch (const Exception& exception) {
    return exception;
  }
  return {ErrorCode{}, "no exception"};
}

}  // namespace

TEST_CASE("records read through the API contain the values of the run file") {
  const Folder dir;
  a_run(3, 1, [](FusedRecord& r) {
    if (r.index == 1) lose(r, Sensor::spd, "missing: no tags");
  }).write(dir / "run");
  const Run run(dir / "run");
  const record::RunReader reader(dir / "run");
  CHECK(run.info().uuid == reader.info().uuid);
  CHECK(std::pair(run.info().status, run.info().status_code) ==
        std::pair(std::string("complete"), StatusCode::complete));
  CHECK(run.count() == 3);
  CHECK(run.zones().empty());
  CHECK(run.axis("radar")->unit == "m");
  CHECK(run.axis("spd")->at(2) == spd_axis().at(2));
  CHECK_FALSE(run.axis("nonsense"));
  const record::FusedRecord stored = reader.read(2);
  const Record record = run.read(2);
  REQUIRE(record.map().size() == run.grid().pixels());
  for (const std::size_t p : {0u, 32u * 64, 64u * 64 - 1})
    CHECK(record.map()[p] == float(depth_mm(stored)[p]) / 1000);
  CHECK(record.label() == stored.label);
  CHECK(record.depth_quality().valid);
  CHECK(record.time().time_since_epoch() == stored.slot_utc);
  CHECK(run.grid().x(5) == Approx(record::MapGrid{}.x().at(5)));
  CHECK(run.grid().y(5) == Approx(record::MapGrid{}.y().at(5)));
  std::vector<std::int64_t> seen;
  run.for_each([&](const Record& r) { return seen.push_back(r.index()), r.index() < 1; });
  CHECK(seen == std::vector<std::int64_t>{0, 1});
  const Record missing = run.read(1);
  CHECK(missing.spd().empty());
  const auto quality = missing.spd_quality();
  CHECK_FALSE(quality.valid);
  CHECK(quality.verdict_code == VerdictCode::missing);
  CHECK(std::pair(quality.verdict, quality.figures) ==
        std::pair(std::string("missing"), std::string("no tags")));
}

TEST_CASE("the API predicts the same depth map as the model, from a record and from its arrays") {
  const std::string kind = GENERATE("one_pixel", "nine_zones");
  const std::string path = made_default_model(kind, "fused"),
                    fresh = made_default_run(kind, "40", "2");
  const echofuse::Model model(path);
  const recon::TrainedModel whole = recon::load_model(path);
  const Run run(fresh);
  const recon::Dataset data = recon::load({fresh});
  const record::RunReader reader(fresh);
  CHECK(model.name() == "factorised");
  CHECK(model.inputs() == "fused");
  CHECK(model.calibrated() == whole.first().uncertainty.has_value());
  CHECK(model.zones() == reader.axis("spd")->zones.size());
  CHECK(model.spd_axis().count == 44);
  CHECK(model.grid().pixels() == 64 * 64);
  for (std::int64_t i = 0; i < run.count(); ++i) {
    const Record record = run.read(i);
    const record::FusedRecord stored = reader.read(i);
    CHECK(std::ranges::equal(record.spd(), counts(stored)));
    CHECK(std::ranges::equal(record.radar(), power(stored)));
    const DepthMap map = predict(model, record);
    REQUIRE(map.fault.empty());
    const auto row = static_cast<std::size_t>(i);
    const recon::Matrix maps = whole.predict(data, {row});
    CHECK(map.depth_m == recon::thresholded_map(maps.row(0), whole.first().scene));
    if (map.body)
      CHECK(map.body->z_m == Approx(recon::body_place(maps.row(0), whole.first().scene).z_m));
    CHECK(map.deviation_m.size() == (model.calibrated() ? 64u * 64 : 0u));
    // Arrays must be free of the range offsets of the run.
    const DepthMap of_arrays = predict(model, photons(data).row(row), profiles(data).row(row));
    CHECK(std::ranges::equal(of_arrays.depth_m, map.depth_m));
    CHECK(of_arrays.deviation_m.size() == map.deviation_m.size());
  }
}

TEST_CASE("the API returns an error message instead of a map if a sensor is missing") {
  const Folder dir;
  const echofuse::Model model(made_model("mean-shape", 80));
  a_run(1, 2, [](FusedRecord& r) { lose(r, Sensor::radar); }).write(dir / "fresh");
  const DepthMap map = predict(model, Run(dir / "fresh").read(0));
  CHECK_THAT(map.fault, Contains("radar"));
  CHECK(map.depth_m.empty());
  CHECK(map.fault_code == FaultCode::sensor_missing);
  const std::vector<float> flat(30, 5);
  CHECK(predict(model, flat, {}).fault == map.fault);
  CHECK(predict(model, flat, std::vector<float>(24, 1)).fault_code == FaultCode::constant_values);
}

TEST_CASE("zones, antennas, calibrations and events read through the API equal those of the run") {
  const Folder dir;
  const auto add_event = [](record::RunWriter& writer) {
    writer.put_event(UtcTime{}, Severity::warning, "radar", "restarted");
  };
  nine_zones(2).begin(add_event).write(dir / "run");
  const Run run(dir / "run");
  const Zones zones = record::RunReader(dir / "run").axis("spd")->zones;
  REQUIRE(run.zones().size() == 9);
  CHECK(run.zones()[8].x == zones[8].x);
  CHECK(run.zones()[8].zero_ps == zones[8].zero_ps);
  REQUIRE(run.calibrations().size() == 2);
  CHECK(run.calibrations()[0].sensor == "spd");
  CHECK(run.calibrations()[0].offset_m == 0.31);
  CHECK((run.events().at(0).source == "radar" && run.events()[0].text == "restarted"));
  a_run(2).antennas({{0, 0, 1, 0}, {1, 0, 1.3, 0.4}, {2, 0, 0.8, -1}}).write(dir / "antennas");
  const Run three(dir / "antennas");
  CHECK(three.antennas().at(1).gain == 1.3);
  const Record record = three.read(1);
  CHECK(record.array().size() == three.axis("array")->count * (3 * 5 + 2));
  CHECK(std::ranges::equal(record.array(),
                           antenna_data(record::RunReader(dir / "antennas").read(1))));
}

TEST_CASE("a record can be used after its run has been closed, and from several threads") {
  const echofuse::Model model(made_model("ridge", 80));
  const Record record = Run(made_run(80)).read(3);
  const std::vector<float> depth_m = predict(model, record).depth_m;
  std::atomic<int> equal = 0;
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i)
    threads.emplace_back([&] { equal += predict(model, record).depth_m == depth_m; });
  for (std::thread& thread : threads) thread.join();
  CHECK(equal == 4);
}

TEST_CASE("exceptions of the API have the code of their cause") {
  const Folder dir;
  const echofuse::Model model(made_model("ridge", 80));
  a_run(4).write(dir / "run");
  damage(dir / "run", "histogram of one byte in record ?1", {1});
  std::filesystem::copy(dir / "run", dir / "short");
  std::filesystem::resize_file(dir / "short", std::filesystem::file_size(dir / "short") / 2);
  for (const char* copy : {"m", "cut"}) std::filesystem::copy(made_model("ridge", 80), dir / copy);
  std::filesystem::resize_file(dir / "cut", std::filesystem::file_size(dir / "cut") - 9);
  const std::string other = one_pixel().write(dir / "other");
  const auto code_of = [&](const auto& body) { return thrown_by(body).code(); };
  const std::vector<std::tuple<std::string, ErrorCode, ErrorCode>> files{
      // the file, and the codes of opening it as a run and as a model
      {"none", ErrorCode::not_found, ErrorCode::not_found},
      {std::string(300, 'x'), ErrorCode::disk, ErrorCode::disk},
      {"short", ErrorCode::damaged, ErrorCode::other_format},
      {"cut", ErrorCode::other_format, ErrorCode::damaged},
      {"m", ErrorCode::other_format, ErrorCode{}},
      {"run", ErrorCode{}, ErrorCode::other_format}};
  for (const auto& [name, as_run, as_model] : files) {
    CAPTURE(name);
    CHECK(code_of([&] { Run(dir / name); }) == as_run);
    CHECK(code_of([&] { echofuse::Model(dir / name); }) == as_model);
  }
  CHECK_THROWS_WITH(Run(dir / "none"), Contains("none"));
  CHECK_THROWS_WITH(echofuse::Model(dir / "none"), Contains("expected a model file"));
  CHECK(code_of([&] { return Run(dir / "run").read(1); }) == ErrorCode::damaged);
  CHECK(code_of([&] { return Run(dir / "run").read(4); }) == ErrorCode::not_found);
  CHECK(code_of([&] { return predict(model, Run(other).read(0)); }) == ErrorCode::usage);
}

TEST_CASE("the API refuses invalid input values and states the reason") {
  const echofuse::Model model(made_model("ridge", 80));
  const auto refused = [&](const std::vector<float>& clicks, const std::vector<float>& echoes,
                           const std::string& text) {
    CHECK_THROWS_WITH(predict(model, clicks, echoes), text);
  };
  const std::vector<float> flat(30, 5), power(24, 1);
  refused(std::vector<float>(29), power,
          "spd: 29 values; the model expects 30 finite values of at least 0");
  const std::pair<float, std::string> wrong[] = {{NAN, "nan"}, {INFINITY, "inf"}, {-1.0F, "-1"}};
  for (const auto& [value, text] : wrong) {
    std::vector<float> clicks = flat;
    clicks[7] = value;
    refused(clicks, power,
            "spd: value 7 is " + text + "; the model expects 30 finite values of at least 0");
  }
  refused(flat, std::vector<float>(24, -INFINITY),
          "radar: value 0 is -inf; the model expects 24 finite values");
  CHECK_THROWS_WITH(Run(made_run(80)).read(80), Contains("no record 80"));
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
  const auto count = [&](const Run&, const Record&) { return ++visits, true; };
  follow(dir / "run", count, 0, [] { return false; });
  CHECK(visits == 2);
}

TEST_CASE("the API reads the axes of a live run again after the run has changed") {
  const Folder dir;
  Rng rng = make_rng(1, 1);
  const auto writer = a_run(0).open(dir / "run");
  writer->append(plate_record(0, 0, 3, rng));
  const Run run(dir / "run");
  const double start = run.axis("spd")->start;
  CHECK(run.read(0).spd().size() == 30);
  CHECK(run.axis("spd")->start == start);
  damage(dir / "run", "SPD axis shifted by ?1 bins", {2.0});
  CHECK(run.axis("spd")->start == start + 2 * run.axis("spd")->step);
  writer->append(plate_record(1, 0, 3, rng));
  CHECK(run.read(1).spd().size() == 30);
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
  Run(dir / "run").for_each(visit, 0, on_damaged);
  follow(dir / "run", visit_live, 0, {}, on_damaged);
  CHECK(seen == std::vector<std::int64_t>{0, 2, 0, 2});
  CHECK(bad == std::vector<std::int64_t>{1, 3, 1, 3});
  CHECK_THROWS_WITH(Run(dir / "run").for_each(visit), Contains("record 1: "));
  CHECK_THROWS_WITH(follow(dir / "run", visit_live), Contains("record 1: "));
}

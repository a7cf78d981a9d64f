// SPDX-License-Identifier: MIT

#include "world.hpp"

namespace {

const Dataset& plates() {
  static const Dataset data = load_plates(160);
  return data;
}

TrainedModel trained_with(const std::string& model) {
  return trained_model(model, 160, {"--set", "fallback=true", "--epochs", "8"});
}

void lose_radar(FusedRecord& r) { lose(r, Sensor::radar); }

}  // namespace

TEST_CASE("a fused model uses the SPD alone for records without radar data") {
  const TrainedModel model = trained_with("factorised-4");
  Dataset lost = plates();
  const Rows rows = {1, 2, 3, 4};
  // The radar data of record 1 are missing.
  lost.records[1].valid.erase(Sensor::radar);
  // The radar fails in record 3, where all bins are equal.
  for (float& v : profiles(lost).row(3)) v = 0.5f;
  for (float& v : profiles(lost).row(1)) v = 0;
  REQUIRE(model.estimators.size() == 2);
  CHECK(model.estimator_for(lost, 1) == &model.estimators[1]);
  CHECK(model.estimator_for(lost, 2) == &model.first());
  CHECK(model.estimator_for(lost, 3) == &model.estimators[1]);
  CHECK(model.fault_of(lost, 1).empty());
  const Matrix maps = model.predict(lost, rows), whole = model.predict(plates(), rows);
  const Matrix alone = model.estimators[1].maps(plates(), rows);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto expected = i % 2 ? whole.row(i) : alone.row(i);
    for (std::size_t p = 0; p < maps.cols; ++p)
      REQUIRE(maps.row(i)[p] == Approx(expected[p]).margin(1e-4));
  }
  // The SPD data of record 2 are missing, and every estimator requires SPD data.
  lost.records[2].valid.erase(Sensor::spd);
  CHECK(model.estimator_for(lost, 2) == nullptr);
  CHECK_THAT(model.fault_of(lost, 2), Catch::Contains("lacks "));
}

TEST_CASE("the fallback for missing radar data is optional and is stored in the model file") {
  const Folder dir;
  TrainedModel model = trained_with("ridge");
  save_model(model, dir / "with");
  const TrainedModel again = load_model(dir / "with");
  REQUIRE(again.estimators.size() == 2);
  Dataset lost = plates();
  for (float& v : profiles(lost).values) v = 0;
  const Rows rows = {5, 6};
  CHECK(again.predict(lost, rows).values == model.predict(lost, rows).values);
  CHECK(again.estimators[1].name == "pca-mlp");
  model.estimators.pop_back();
  save_model(model, dir / "without");
  const TrainedModel plain = load_model(dir / "without");
  CHECK(plain.estimators.size() == 1);
  CHECK_THAT(plain.fault_of(lost, 5), Catch::Contains("radar is the same in every bin"));
  for (const std::string inputs : {"spd", "radar"}) {
    TrainOptions options = quiet_options("ridge");
    options.inputs = inputs, options.fallback = true;
    CHECK(train(plates(), options).estimators.size() == 1);
  }
}

TEST_CASE("the domain-shift test counts only records that have a predicted uncertainty") {
  TrainedModel model = trained_with("ridge");
  REQUIRE(model.estimators.size() == 2);
  model.estimators[1].uncertainty.reset();
  const Dataset data = load_plates(30, 2, [](FusedRecord& r) {
    if (r.index % 3 == 0) lose_radar(r);
  });
  CHECK(domain_shift_of(model, data).assessed == 20);
}

TEST_CASE("reconstruct and evaluate report maps that were predicted from the SPD alone") {
  const ReconFolder dir;
  const std::string model = made_model("ridge", 100, 1, {"--epochs", "10"});
  a_run(4, 2, [](FusedRecord& r) {
    if (r.index == 2) lose_radar(r);
  }).write(dir / "live");
  CHECK_THAT(
      dir.done("reconstruct " + model + " live --out o", 5),
      Catch::Contains("4 records reconstructed, 0 left out; 1 with a fallback model (radar lost"));
  CHECK(std::filesystem::exists(dir / "o/000002.png"));
  CHECK_THAT(contents(dir / "o/records.csv"),
             Catch::Contains("\n1,\"ok\",") && Catch::Contains("\n2,\"radar lost: SPD alone\","));
  CHECK_THAT(dir.recon("evaluate " + model + " live").text,
             Catch::Contains("4 records") && Catch::Contains("1 records: radar lost: SPD alone"));

  // The radar axis of this run has no bins, as in a run without a configured radar.
  a_run(3, 3, lose_radar).radar(Axis{"radar", "power", "m", 0, 0, 1, 1}).write(dir / "dark");
  CHECK(dir.json("evaluate " + model + " dark")["fallback_records"] == 3);
}

TEST_CASE("evaluate counts but does not score records for which the model predicts no map") {
  const ReconFolder dir;
  save_model(trained_with("ridge"), dir / "m");
  a_run(6, 2, [](FusedRecord& r) {
    if (r.index >= 3) lose_radar(r);
    if (r.index >= 4) std::fill(counts(r).begin(), counts(r).end(), 2);
  }).write(dir / "live");
  const auto json = dir.json("evaluate m live");
  CHECK(json["records"] == 4);
  CHECK(json["fallback_records"] == 1);
  CHECK(json["left_out"] == 2);
  CHECK_THAT(dir.recon("evaluate m live").text,
             Catch::Contains("2 records with a depth map left out: missing sensor "));
}

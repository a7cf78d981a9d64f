// SPDX-License-Identifier: MIT

#include "world.hpp"

namespace {

TrainedModel trained() {
  return trained_model("ridge", 160, {"--set", "fallback=true", "--epochs", "8"});
}

void lose_radar(FusedRecord& r) { lose(r, Sensor::radar); }

}  // namespace

TEST_CASE("the fallback for missing radar data is optional and is stored in the model file") {
  const Folder dir;
  TrainedModel model = trained();
  save_model(model, dir / "with");
  const TrainedModel again = load_model(dir / "with");
  REQUIRE(again.estimators.size() == 2);
  const Dataset plates = load_plates(160);
  Dataset lost = plates;
  for (float& v : profiles(lost).values) v = 0;
  const Rows rows = {5, 6};
  CHECK(again.predict(lost, rows).values == model.predict(lost, rows).values);
  CHECK(again.estimators[1].name == "pca-mlp");
  model.estimators.pop_back();
  save_model(model, dir / "without");
  const TrainedModel plain = load_model(dir / "without");
  CHECK(plain.estimators.size() == 1);
  CHECK_THAT(plain.fault_of(lost, 5), Contains("radar is the same in every bin"));
  for (const std::string inputs : {"spd", "radar"}) {
    TrainOptions options = quiet_options("ridge");
    options.inputs = inputs, options.fallback = true;
    CHECK(train(plates, options).estimators.size() == 1);
  }
}

TEST_CASE("the domain-shift test counts only records that have a predicted uncertainty") {
  TrainedModel model = trained();
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
  a_run(6, 2, [](FusedRecord& r) {
    if (r.index >= 3) lose_radar(r);
    if (r.index >= 4) std::ranges::fill(counts(r), 2);
  }).write(dir / "live");
  dir.says("reconstruct " + model + " live --out o",
           {"\no: 4 records reconstructed, 2 left out; 1 with a fallback model (radar lost"}, 5);
  CHECK(std::filesystem::exists(dir / "o/000003.png"));
  CHECK_THAT(contents(dir / "o/records.csv"),
             Contains("\n1,\"ok\",") && Contains("\n3,\"radar lost: SPD alone\","));
  dir.says("evaluate " + model + " live", {"\n4 records", "\n1 records: radar lost: SPD alone",
                                           "2 records with a depth map left out: missing sensor "});
  const auto json = dir.json("evaluate " + model + " live");
  CHECK((json["records"] == 4 && json["fallback_records"] == 1 && json["left_out"] == 2));
  // The radar axis of this run has no bins, as in a run without a configured radar.
  a_run(3, 3, lose_radar).radar(Axis{"radar", "power", "m", 0, 0, 1, 1}).write(dir / "dark");
  CHECK(dir.json("evaluate " + model + " dark")["fallback_records"] == 3);
}

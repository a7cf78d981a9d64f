// SPDX-License-Identifier: MIT
// Tests that every model either predicts finite maps for degenerate data sets or refuses them.
#include "world.hpp"

namespace {

struct Peculiar {
  const char* name;
  std::int64_t count;
  Change change;
  const char* scaling = "record";
};

Change scaled_power(float by) {
  return [by](FusedRecord& r) {
    for (float& v : power(r)) v *= by;
  };
}

// Replaces the data of the chosen sensors by those of a single plate.
Change same(std::initializer_list<Sensor> sensors) {
  return [all = SensorSet(sensors)](FusedRecord& r) {
    Rng rng = make_rng(1, 1);
    const FusedRecord plate = plate_record(0, 0.5, 3.5, rng);
    if (all.contains(Sensor::spd)) counts(r) = counts(plate);
    if (all.contains(Sensor::radar)) power(r) = power(plate);
    if (all.contains(Sensor::depth)) depth_mm(r) = depth_mm(plate);
  };
}

Change filled(std::uint16_t mm) {
  return [mm](FusedRecord& r) { std::ranges::fill(depth_mm(r), mm); };
}

const std::vector<Peculiar> peculiar_sets = {
    {"one record", 1, {}},
    {"two records", 2, {}},
    {"three records", 3, {}},
    {"one record, repeated", 12, same({Sensor::spd, Sensor::radar, Sensor::depth})},
    {"equal inputs, different maps", 12, same({Sensor::spd, Sensor::radar})},
    {"equal maps, different inputs", 12, same({Sensor::depth})},
    {"empty maps", 12, filled(0)},
    {"maps of one depth", 12, filled(3000)},
    {"constant bins", 40,
     [](FusedRecord& r) {
       for (std::size_t i = 0; i < counts(r).size(); i += 2) counts(r)[i] = 3;
       for (std::size_t i = 0; i < power(r).size(); i += 2) power(r)[i] = 0.5f;
     },
     "plain"},
    {"one click per record", 12,
     [](FusedRecord& r) {
       std::ranges::fill(counts(r), 0);
       counts(r)[static_cast<std::size_t>(r.index) % counts(r).size()] = 1;
     }},
    {"one label", 12, [](FusedRecord& r) { r.label = "person"; }},
    {"counts at the limit", 40,
     [](FusedRecord& r) {
       for (auto& n : counts(r)) n = n > 1000 ? 0xfffffffeu : n;
     },
     "plain"},
    {"huge powers", 40, scaled_power(1e30f), "plain"},
    {"tiny powers", 40, scaled_power(1e-30f), "plain"},
    {"negative powers", 40, scaled_power(-1), "plain"},
    {"empty room in half of the records", 40,
     [](FusedRecord& r) {
       if (r.index % 2 == 0) return;
       for (auto& n : counts(r)) n = static_cast<std::uint32_t>(&n - counts(r).data()) % 2;
       std::ranges::fill(depth_mm(r), 0);
     }},
};

}  // namespace

TEST_CASE("every model trained on degenerate data predicts finite maps or gives a one-line error") {
  std::vector<std::string> names = model_names();
  names.insert(names.end(), {"nearest-16", "auto"});
  for (const auto& set : peculiar_sets) {
    Dataset data = load_plates(set.count, 1, set.change), others = load_plates(6, 2);
    // Identical records would otherwise be excluded as copies.
    for (RecordInfo& info : data.records) info.content = 0;
    for (const auto& name : names) {
      // Model selection is slow, because each candidate is trained five times.
      if (name == "auto" && set.count > 3) continue;
      CAPTURE(set.name, name);
      TrainOptions o = quiet_options(name, 3);
      o.scaling = set.scaling;
      // Two models are enough to test the uncertainty, because all models use the same code to fit
      // it.
      o.uncertainty = name == "ridge" || name == "factorised";
      // One model is enough to test the fallback, because all models use the same code to fit it.
      o.fallback = name == "ridge";
      if (name.ends_with("mlp")) o.fit.hidden = {24};
      if (name == "auto") o.candidates = {"empty", "mean", "factorised-4", "ridge", "nearest"};
      try {
        const TrainedModel model = train(data, o);
        for (const Dataset* assessed : {&data, &others}) {
          const Rows rows = rows_to_evaluate(model, *assessed, true);
          CHECK(all_finite(model.predict(*assessed, rows).values));
          const Records records = prepare_records(model, *assessed);
          const Evaluation e = evaluate(model, records, rows);
          // One model is enough to test the baselines, because the baselines do not depend on the
          // model.
          if (name == "ridge") {
            const Rows seen = model.rows_of(data, Subset::train);
            // The nearest-neighbour baseline is left out if all evaluated records are copies of
            // training records.
            const auto baselines =
                score_baselines(*assessed, rows, model.first().scene, data, seen).size();
            CHECK((baselines == 3 || (assessed == &data && baselines == 2)));
          }
          CHECK(std::isfinite(e.metrics[metric_rmse_m].mean));
        }
      } catch (const Error& error) {
        CHECK(error.code() == ExitCode::failed);
        CHECK_THAT(error.what(), Contains("records") || Contains("tested: the maps"));
        CHECK_THAT(error.what(), !Contains("\n"));
        // The models mean, ridge and mlp must accept data sets of 40 records, which are large
        // enough.
        if (set.count == 40) CHECK((name != "mean" && name != "ridge" && name != "mlp"));
      }
    }
  }
}

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

record::FusedRecord plate(std::uint64_t seed, double x, double z) {
  Rng rng = make_rng(seed, 1);
  return plate_record(0, x, z, rng);
}

const std::vector<Peculiar> peculiar_sets = {
    {"one record", 1, {}},
    {"two records", 2, {}},
    {"three records", 3, {}},
    {"one record, repeated", 12,
     [](FusedRecord& r) {
       const auto same = plate(1, 0.5, 3.5);
       counts(r) = counts(same), power(r) = power(same), depth_mm(r) = depth_mm(same);
     }},
    {"equal inputs, different maps", 12,
     [](FusedRecord& r) {
       const auto same = plate(1, 0.5, 3.5);
       counts(r) = counts(same), power(r) = power(same);
     }},
    {"equal maps, different inputs", 12,
     [](FusedRecord& r) { depth_mm(r) = depth_mm(plate(1, 0.5, 3.5)); }},
    {"empty maps", 12,
     [](FusedRecord& r) { std::fill(depth_mm(r).begin(), depth_mm(r).end(), 0); }},
    {"maps of one depth", 12,
     [](FusedRecord& r) { std::fill(depth_mm(r).begin(), depth_mm(r).end(), 3000); }},
    {"constant bins", 40,
     [](FusedRecord& r) {
       for (std::size_t i = 0; i < counts(r).size(); i += 2) counts(r)[i] = 3;
       for (std::size_t i = 0; i < power(r).size(); i += 2) power(r)[i] = 0.5f;
     },
     "plain"},
    {"one click per record", 12,
     [](FusedRecord& r) {
       std::fill(counts(r).begin(), counts(r).end(), 0);
       counts(r)[static_cast<std::size_t>(r.index) % counts(r).size()] = 1;
     }},
    {"one label", 12, [](FusedRecord& r) { r.label = "person"; }},
    {"counts at the limit", 40,
     [](FusedRecord& r) {
       for (auto& n : counts(r)) n = n > 1000 ? 0xfffffffeu : n;
     },
     "plain"},
    {"huge powers", 40,
     [](FusedRecord& r) {
       for (auto& v : power(r)) v *= 1e30f;
     },
     "plain"},
    {"tiny powers", 40,
     [](FusedRecord& r) {
       for (auto& v : power(r)) v *= 1e-30f;
     },
     "plain"},
    {"negative powers", 40,
     [](FusedRecord& r) {
       for (auto& v : power(r)) v = -v;
     },
     "plain"},
    {"empty room in half of the records", 40,
     [](FusedRecord& r) {
       if (r.index % 2 == 0) return;
       for (auto& n : counts(r)) n = static_cast<std::uint32_t>(&n - counts(r).data()) % 2;
       std::fill(depth_mm(r).begin(), depth_mm(r).end(), 0);
     }},
};

}  // namespace

TEST_CASE(
    "every model trained on degenerate data predicts finite maps or causes a one-line error") {
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
        CHECK_THAT(error.what(), Catch::Contains("records") || Catch::Contains("tested: the maps"));
        CHECK_THAT(error.what(), !Catch::Contains("\n"));
        // The models mean, ridge and mlp must accept data sets of 40 records, which are large
        // enough.
        if (set.count == 40) CHECK((name != "mean" && name != "ridge" && name != "mlp"));
      }
    }
  }
}

TEST_CASE(
    "train, evaluate and reconstruct accept tiny or half-empty runs or give a one-line error") {
  const auto& half = peculiar_sets.back();
  const ReconFolder dir;
  a_run(1).write(dir / "1");
  a_run(2).write(dir / "2");
  a_run(half.count, 1, half.change).write(dir / "half");
  const auto train_on = [&](const std::string& model, const std::string& run) {
    std::filesystem::remove(dir / "m");
    return dir.recon("train -q --model " + model +
                     " --epochs 3 --set candidates=mean,ridge --out m " + run);
  };
  const auto is_line = [](const std::string& text) {
    return !text.empty() && text.find('\n') == text.size() - 1;
  };
  for (const std::string model : {"mean", "mlp", "factorised", "auto"}) {
    CAPTURE(model);
    const Outcome one = train_on(model, "1");
    CHECK(one.code == 1);
    CHECK_THAT(one.text, Catch::Contains("1 usable records leave 1"));
    CHECK(is_line(one.text));
    for (const std::string run : {"2", "half"}) {
      CAPTURE(run);
      const Outcome trained = train_on(model, run);
      CAPTURE(trained.text);
      if (run == "2" && model == "auto") {
        CHECK(trained.code == 1);
        CHECK(is_line(trained.text));
        continue;
      }
      REQUIRE(trained.code == 0);
      CHECK_THAT(dir.done("evaluate --all --json m " + run), !Catch::Contains("\"rmse_m\": null"));
      const Outcome made =
          dir.recon("reconstruct -q m " + run + " --out " + (dir / ("maps-" + model + run)));
      CAPTURE(made.text);
      CHECK((made.code == 0 || made.code == 5));
    }
  }
}

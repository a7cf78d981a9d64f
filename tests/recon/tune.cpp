// SPDX-License-Identifier: MIT
// Tests the tuning of a model to a room other than the training room, in which the radar reports
// shorter ranges.
#include "recon/train/tune.hpp"

#include <map>

#include "recon/numbers/statistics.hpp"
#include "world.hpp"

namespace {

constexpr double other_start_m = -0.1;

// Returns records of plates. If `other` is true, the radar reports ranges that are 10 cm shorter,
// as it might in another room.
Dataset plates(std::int64_t count, std::uint64_t seed, bool other) {
  Dataset data = load_plates(count, seed);
  if (other) subtract_range_offset(data, -other_start_m);
  return data;
}

const TrainedModel& old_model(const std::string& kind) {
  static std::map<std::string, TrainedModel> models;
  if (!models.contains(kind)) {
    TrainOptions options = quiet_options(kind, 30);
    if (kind == "factorised") options.fit.basis = 4;
    if (kind.ends_with("mlp")) options.fit.hidden = {{32}};
    if (kind == "pca-mlp") options.fit.basis = 16;
    models.emplace(kind, train(plates(300, 1, false), options));
  }
  return models.at(kind);
}

TunedModel tune(const TrainedModel& from, const Dataset& data, const TuneOptions& options) {
  return recon::tune({{from, data, data}}, options);
}

TuneOptions all_records() {
  TuneOptions out;
  out.split.test_share = out.split.validation_share = 0;
  return out;
}

double iou(const TrainedModel& model, const Dataset& data) {
  return scores_of(model, data)[metric_iou].mean;
}

}  // namespace

TEST_CASE("tuning with few records adapts a model to another room") {
  const Dataset fresh = plates(100, 9, true);
  for (const std::string kind : {"factorised", "mean-shape", "mlp", "pca-mlp"}) {
    CAPTURE(kind);
    const TrainedModel& old = old_model(kind);
    const TunedModel tuned = tune(old, plates(20, 5, true), all_records());
    CHECK(tuned.model.first().name == kind);
    const double before = iou(old, fresh), after = iou(tuned.model, fresh);
    CAPTURE(before, after, to_text(tuned));
    // An MLP of this size is inaccurate in both rooms, so an improvement of less than 0.03 in IoU
    // is accepted.
    CHECK(after > before + (kind == "mlp" ? 0 : 0.03));
    CHECK(tuned.chosen > 0);
    CHECK(tuned.table.front().name == "unchanged");
    CHECK_FALSE(tuned.model.first().uncertainty);
    CHECK(calibration_of(tuned.model) == std::string("not calibrated"));
  }
}

TEST_CASE("tuning with ten records changes a model only if the gain is significant") {
  const Dataset few = plates(10, 5, true), fresh = plates(150, 6, true);
  const TunedModel tuned = tune(old_model("factorised"), few, all_records());
  CHECK(tuned.table[tuned.chosen].name != "unchanged");
  CHECK(iou(tuned.model, fresh) > iou(old_model("factorised"), fresh));
  const TunedModel at_home = tune(old_model("factorised"), plates(10, 7, false), all_records());
  CHECK(at_home.table.front().name == "unchanged");
  const double before = at_home.table.front().metrics[metric_iou].mean;
  CHECK(at_home.table[at_home.chosen].metrics[metric_iou].mean >= before);
}

TEST_CASE("tuning with records of the training room keeps the accuracy and adds an uncertainty") {
  const TrainedModel& old = old_model("factorised");
  const Dataset fresh = plates(100, 9, false);
  const TunedModel tuned = tune(old, plates(60, 6, false), all_records());
  CAPTURE(to_text(tuned));
  CHECK(iou(tuned.model, fresh) > iou(old, fresh) - 0.02);
  CHECK(tuned.table.back().name == "these records alone");
  CHECK(tuned.model.first().uncertainty);
  CHECK(tuned.model.was_trained_on(fresh) == false);
}

TEST_CASE("tuning chooses the better of two start models, whatever their order") {
  const TrainedModel& old = old_model("factorised");
  TrainOptions options = quiet_options("factorised-4", 30);
  options.fit.seed = 2;
  const TrainedModel there = train(plates(300, 2, true), options);
  options.fit.seed = 3;
  const TrainedModel twice = train(plates(300, 3, true), options);
  const auto row = [](const TunedModel& m) { return m.table[m.chosen].name; };
  for (const std::int64_t records : {10, 60}) {
    const Dataset data = plates(records, 5, true), fresh = plates(100, 9, true);
    const auto tuned = [&](const TrainedModel& a, const char* name_a, const TrainedModel& b,
                           const char* name_b) {
      return recon::tune({{a, data, data, name_a}, {b, data, data, name_b}}, all_records());
    };
    const TunedModel far_first = tuned(old, "far", there, "there");
    CAPTURE(to_text(far_first));
    CHECK_THAT(row(far_first), StartsWith("there: "));
    CHECK_THAT(to_text(far_first),
               Contains("gain of start model there over far on the same folds: "));
    CHECK(iou(far_first.model, fresh) > iou(tune(old, data, all_records()).model, fresh));
    CHECK_THAT(row(tuned(there, "there", old, "far")), StartsWith("there: "));
    // With only ten records, the difference between two similar models is not significant, so
    // either model may be chosen.
    if (records > 10)
      CHECK(row(tuned(there, "there", twice, "twice")) ==
            row(tuned(twice, "twice", there, "there")));
    // If two models are equally good, the first one is chosen.
    const auto equal = tuned(there, "first", there, "same");
    CHECK_THAT(row(equal), StartsWith("first: "));
    CHECK_THAT(to_text(equal), Contains("+0.000 +- 0.000"));
  }
}

TEST_CASE("tuning accepts axes that differ from the model axes by less than a bin") {
  const TrainedModel& old = old_model("factorised");
  const Dataset data = plates(20, 5, false);
  Dataset near = data, far = data, longer = data;
  profiles(near).axis.start += 0.1, profiles(far).axis.start += 0.3;
  // The axes start at the same range, but their steps differ, so they end at different ranges.
  profiles(longer).axis.step *= 1 + 1.5 / profiles(longer).axis.count;
  match_for_tuning(old, "m", near);
  CHECK(same_axis(profiles(near).axis, old.first().features.axes.radar));
  CHECK(tune(old, near, all_records()).table.front().name == "unchanged");
  CHECK_THROWS_WITH(match_for_tuning(old, "m", far),
                    EndsWith(": start differs by 1.2 bins (limit 1)"));
  CHECK_THROWS_WITH(match_for_tuning(old, "m", longer),
                    EndsWith(": step differs: 1.5 bins at the end of the axis (limit 1)"));
}

TEST_CASE("every tuned model can be saved, loaded and evaluated") {
  const record::Antennas line = {{0, 0, 1, 0}, {1, 0, 1, 0}, {2, 0, 1, 0}, {3, 0, 1, 0}};
  const Folder dir;
  const auto plates_of = [&](const std::string& inputs, std::int64_t count, std::uint64_t seed) {
    std::filesystem::remove(dir / "run");
    a_run(count, seed).antennas(inputs == "fused" ? line : record::Antennas{}).write(dir / "run");
    return load({dir / "run"});
  };
  for (const std::string inputs : {"fused", "fused-profile", "spd"}) {
    TrainOptions options = quiet_options(inputs == "spd" ? "pca-mlp-16" : "factorised-4", 2);
    options.inputs = inputs, options.fallback = options.uncertainty = true;
    const TrainedModel old = train(plates_of(inputs, 60, 1), options);
    REQUIRE(old.estimators.size() == (inputs == "fused" ? 3 : inputs == "spd" ? 1 : 2));
    const Dataset fresh = plates_of(inputs, 6, 9);
    Dataset lost = fresh;
    for (RecordInfo& info : lost.records) info.valid.erase(Sensor::radar);
    for (const std::int64_t records : {10, 49, 50})
      for (const std::string only : {"unchanged", "background and position corrected",
                                     "fine-tuned, L2 penalty 10 over N", "these records alone"}) {
        CAPTURE(inputs, records, only);
        TuneOptions how = all_records();
        how.only = only, how.tuning.steps = 2;
        std::filesystem::remove(dir / "m");
        try {
          save_model(tune(old, plates_of(inputs, records, 5), how).model, dir / "m");
        } catch (const Error&) {
          // Tuning may be rejected if the model uses only the SPD or if there are fewer than 50
          // records.
          CHECK((inputs == "spd" || records < 50));
          continue;
        }
        const TrainedModel read = load_model(dir / "m");
        const bool calibrated = read.first().uncertainty.has_value();
        CHECK(calibrated == (records == 50 || only == "unchanged"));
        const Records seen = prepare_records(read, fresh);
        CHECK(evaluate(read, seen, rows_to_evaluate(read, seen.data, false))
                  .calibration.has_value() == calibrated);
        // Each estimator must predict maps on its own, whether or not it has an uncertainty.
        if (inputs == "spd") continue;
        const Prediction p = predict(read, prepare_records(read, lost).data, all_rows(6));
        CHECK((p.uncertainties.empty() || !p.uncertainties[0].stated) == (records < 50));
      }
  }
}

TEST_CASE("tuning that trains only on new records adopts their axes and their radar response") {
  const record::RadarResponse narrow{0.5, {1, 0.8, 0.4, 0.1, 0}},
      wide{0.5, {1, 0.94, 0.77, 0.54, 0.3, 0.1, 0}};
  TrainOptions options = quiet_options("factorised-4", 2);
  options.fallback = options.uncertainty = true;
  TrainedModel old = train(plates(60, 1, false), options);
  old.response.radar = wide;
  Dataset own = plates(60, 5, false);
  profiles(own).axis.start += 0.05;
  for (Source& source : own.sources) source.response.radar = narrow;
  Dataset matched = own;
  match_for_tuning(old, "m", matched);
  REQUIRE(profiles(matched).values != profiles(own).values);
  for (const bool alone : {false, true}) {
    CAPTURE(alone);
    TuneOptions how = all_records();
    how.only = alone ? "these records alone" : "unchanged";
    const TrainedModel model = recon::tune({{old, matched, own}}, how).model;
    CHECK(model.response.radar == (alone ? narrow : wide));
    CHECK(same_axis(model.first().features.axes.radar, profiles(own).axis) == alone);
    // Before prediction, a run is converted to the axes and the radar response of the training
    // data.
    Dataset used = own;
    model.match(used);
    CHECK((profiles(used).values == profiles(own).values) == alone);
    REQUIRE(model.estimators.size() == old.estimators.size());
    CHECK(model.estimators.back().features.axes.spd.count > 0);
    CHECK(iou(model, used) > 0);
  }
}

TEST_CASE("a model that cannot be tuned is refused with a one-line error") {
  const ReconFolder dir;
  save_model(old_model("factorised"), dir / "old");
  a_run(9).write(dir / "few"), a_run(20).write(dir / "run");
  a_run(20, 1, [](FusedRecord& r) { lose(r, Sensor::radar); }).write(dir / "blind");
  const std::string train = "train -q --out new --from ";
  const std::string too_few = "9 usable records; tuning needs at least 10";
  dir.refuses(train + "old few", 1, too_few);
  dir.refuses(train + "old --from old few", 1, too_few);
  dir.refuses(train + "old --model mlp run", 2, "--model cannot be combined with --from");
  dir.refuses(train + "old blind", 1, "no record has radar data");
  dir.refuses(train + "run run", 1, "run: is a run; expected a model file");
  dir.refuses(train + made_model("mean", 20) + " run", 1, "cannot be tuned");
}

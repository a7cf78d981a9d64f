// SPDX-License-Identifier: MIT
#include "recon/trust/uncertainty.hpp"

#include "recon/data/response_conversion.hpp"
#include "recon/train/fit_uncertainty.hpp"
#include "world.hpp"

namespace {

const Words more_validation{"--set", "validation_share=0.3"};

const TrainedModel& trained() {
  static const TrainedModel model = trained_model("factorised-4", 800, more_validation);
  return model;
}

std::vector<PredictionUncertainty> uncertainties_of(const Dataset& data) {
  return predict(trained(), data, all_rows(data.size())).uncertainties;
}

UncertaintyCalibration calibration_of(const TrainedModel& model, const Dataset& data) {
  return evaluate(model, prepare_records(model, data), all_rows(data.size())).calibration.value();
}

float nearest_m(const Dataset& data, std::size_t row) {
  float out = 1e9f;
  for (const float z : depth_maps(data).row(row))
    if (z > 0) out = std::min(out, z);
  return out;
}

}  // namespace

TEST_CASE("a weighted linear fit recovers known coefficients and ignores records of weight 0") {
  Rng rng = make_rng(1, 1);
  std::normal_distribution<float> normal;
  Matrix inputs(0, 6);
  std::vector<float> targets, counts;
  const std::vector<double> truth = {1, -2, 0.5, 3, 0, -1};
  for (int i = 0; i < 200; ++i) {
    inputs.add_row(quadratic_terms(std::vector<float>{normal(rng), 10 * normal(rng)}));
    const double right = product(inputs.row(inputs.rows - 1), truth);
    targets.push_back(i % 2 ? 1000 : static_cast<float>(right));
    counts.push_back(i % 2 ? 0.f : 1.f);
  }
  const auto found = linear_fit(inputs, targets, counts, 1e-9);
  REQUIRE(found.size() == truth.size());
  for (std::size_t c = 0; c < truth.size(); ++c) CHECK(found[c] == Approx(truth[c]).margin(1e-3));
}

TEST_CASE("the lateral interval grows with the errors of records like it, and of wider responses") {
  Rng rng = make_rng(2, 2);
  std::uniform_real_distribution<float> uniform;
  std::normal_distribution<double> normal;
  Matrix predictors(0, 2);
  std::vector<double> error_m, of_wider;
  for (int i = 0; i < 2000; ++i) {
    const std::vector<float> row{uniform(rng), uniform(rng)};
    predictors.add_row(row);
    error_m.push_back(std::abs(normal(rng)) * 0.02 * std::exp(double{row[0]}));
    of_wider.push_back(3 * error_m.back());
  }
  LateralError interval_m;
  CHECK(std::isnan(interval_m(predictors.row(0))));
  interval_m.add_converted(2, predictors, of_wider);  // nothing has been learnt yet
  CHECK(std::isnan(interval_m(predictors.row(0), 2)));
  interval_m.fit(predictors, error_m, predictors.rows);
  interval_m.add_converted(2, predictors, of_wider);
  constexpr double quantile = 1.645;  // 90 % quantile of the absolute value of a normal variable
  for (const float x : {0.1f, 0.5f, 0.9f}) {
    const std::vector<float> at{x, 0.5f};
    const double expected_m = quantile * 0.02 * std::exp(double{x});
    CHECK(interval_m(at) == Approx(expected_m).epsilon(0.15));
    CHECK(interval_m(at, 1.5) == Approx(2 * interval_m(at)).epsilon(0.02));
    CHECK(interval_m(at, 2) == Approx(3 * interval_m(at)).epsilon(0.02));
  }
}

TEST_CASE("the 90 % lateral interval contains 90 % of bodies and widens with noise") {
  const Dataset clean = load_plates(400, 2);
  const UncertaintyCalibration c = calibration_of(trained(), clean);
  CHECK(c.within_90 == Approx(0.9).margin(0.07));
  Dataset noisy = clean;
  Rng rng = make_rng(4, 4);
  std::normal_distribution<float> noise(0, 0.02f);
  for (float& v : profiles(noisy).values) v += noise(rng);
  const UncertaintyCalibration n = calibration_of(trained(), noisy);
  CHECK(n.lateral_interval_90_m > 1.1 * c.lateral_interval_90_m);
  CHECK(n.within_90 > 0.75);
}

TEST_CASE("outliers are flagged with a reason, and records like the training data rarely are") {
  const Dataset clean = load_plates(400, 2);
  const auto share_of = [&](const std::function<void(Dataset&)>& change, const char* why = "") {
    Dataset data = clean;
    change(data);
    return share_flagged(uncertainties_of(data), why);
  };
  Rng rng = make_rng(5, 5);
  std::poisson_distribution<int> dark(50);
  std::normal_distribution<float> normal;
  CHECK(share_of([](Dataset&) {}) < 0.03);
  CHECK(share_of([](Dataset& d) { d = with_second_bodies(d); }) > 0.5);
  const auto darken = [&](Dataset& d) {
    for (float& v : photons(d).values) v = static_cast<float>(dark(rng));
  };
  CHECK(share_of(darken, "empty") > 0.98);
  const auto brighten = [](Dataset& d) {
    for (RecordInfo& info : d.records) info.clicks_per_pulse = 0.4;
  };
  CHECK(share_of(brighten, "saturated (0.40 clicks per laser pulse)") == 1);
  const auto lose_echoes = [&](Dataset& d) {
    for (float& v : profiles(d).values) v = normal(rng);
  };
  CHECK(share_of(lose_echoes) > 0.98);
  const auto amplify = [](Dataset& d) {
    for (float& v : profiles(d).values) v *= 4;
    for (float& v : photons(d).values) v *= 0.5f;
  };
  CHECK(share_of(amplify) < 0.03);
  const Dataset far = load_plates(50, 2, [](FusedRecord& r) {
    // The histogram is shifted by 9 bins (54 cm).
    std::rotate(counts(r).begin(), counts(r).end() - 9, counts(r).end());
    std::rotate(power(r).begin(), power(r).end() - 2, power(r).end());
  });
  CHECK(share_flagged(uncertainties_of(far), "outside the training records' distances") > 0.3);
}

TEST_CASE("outlier detection does not depend on the order of training records") {
  const Dataset data = load_plates(600), fresh = load_plates(300, 2);
  Rows rows = all_rows(600);
  std::sort(rows.begin(), rows.end(),
            [&](std::size_t a, std::size_t b) { return nearest_m(data, a) < nearest_m(data, b); });
  CHECK(share_flagged(outlier_scores(data, rows, fresh)) < 0.03);
  CHECK(share_flagged(outlier_scores(data, rows, with_second_bodies(fresh))) > 0.5);
}

TEST_CASE("outlier detection is fitted to the training records only") {
  Dataset data = load_plates(300);
  for (std::size_t i = 0; i < 100; ++i) data.records[i].label = two_people_label;
  Rows rows = all_rows(300);
  rows.erase(rows.begin(), rows.begin() + 100);
  const Dataset alone = part_of(data, rows);
  const auto scores = [&](const Dataset& training, const Rows& of_training) {
    std::vector<double> out;
    for (const auto& s : outlier_scores(training, of_training, alone)) out.push_back(s.two_bodies);
    return out;
  };
  CHECK(scores(data, rows) == scores(alone, all_rows(200)));
}

TEST_CASE("photon thinning keeps the expected fraction of non-integer counts in each zone") {
  Dataset data = load_plates(100, 2);
  // In a calibrated run, the range correction makes the counts fractional.
  photons(data).axis.zones = Zones(2), photons(data) = Matrix(100, 2 * spd_axis().count);
  std::fill(photons(data).values.begin(), photons(data).values.end(), 0.75f);
  Rng rng = make_rng(3, 3);
  degrade(data, rng);
  double left[2] = {0, 0};
  for (std::size_t i = 0; i < photons(data).values.size(); ++i)
    left[i / spd_axis().count % 2] += double{photons(data).values[i]};
  // Counts of 0.75 are rounded to one photon. The expected value is the mean of 10^u, where u is
  // uniformly distributed between -2.5 and 0.
  for (const double zone : left)
    CHECK(zone / (100 * spd_axis().count) == Approx(0.173).epsilon(0.3));
}

TEST_CASE("degrading a record adds noise of the same relative strength to all antenna lags") {
  constexpr std::size_t records = 400, bins = 40, values = 5;
  Dataset data = load_plates(records, 2);
  antenna_lags(data).axis = Axis{"array", "lags", "m", bins, 0, 0.25, 2};
  antenna_lags(data) = Matrix(records, bins * values);
  for (std::size_t i = 0; i < records; ++i) antenna_lags(data).row(i)[0] = 7;
  const Matrix power = profiles(data);
  Rng rng = make_rng(3, 3);
  degrade(data, rng);
  double lag_0 = 0, lag_2 = 0, of_power = 0;
  for (std::size_t i = 0; i < records; ++i) {
    const auto row = antenna_lags(data).row(i).subspan(values);  // without the bin of the echo
    for (std::size_t k = 0; k < row.size(); ++k) {
      const double square = std::pow(double{row[k]} / 7, 2) / (bins - 1);
      lag_0 += k % values == 0 ? square : 0, lag_2 += k % values >= 3 ? square : 0;
    }
    const double top = std::ranges::max(power.row(i));
    for (std::size_t b = 0; b < power.cols; ++b)
      of_power += std::pow((profiles(data).row(i)[b] - power.row(i)[b]) / top, 2) /
                  static_cast<double>(power.cols);
  }
  CHECK(lag_0 == Approx(of_power).epsilon(0.1));
  CHECK(lag_2 == Approx(of_power).epsilon(0.1));
}

TEST_CASE("an uncertainty fitted to pure noise covers 90 % of the errors of new records") {
  // The errors are pure noise. A regression with ten terms explains part of the noise in the 60
  // records used to fit it.
  std::vector<double> held;
  for (std::uint64_t trial = 0; trial < 200; ++trial) {
    Rng rng = make_rng(trial, 8);
    std::normal_distribution<float> normal;
    const auto draw = [&](std::size_t count, Matrix& predictors, std::vector<double>& errors) {
      predictors.cols = 3;
      for (std::size_t i = 0; i < count; ++i) {
        predictors.add_row(std::vector<float>{normal(rng), normal(rng), normal(rng)});
        errors.push_back(std::exp(double{normal(rng)}));
      }
    };
    Matrix seen(0, 3), fresh(0, 3);
    std::vector<double> seen_errors, fresh_errors;
    draw(60, seen, seen_errors);
    draw(50, fresh, fresh_errors);
    LateralError lateral;
    lateral.fit(seen, seen_errors, seen.rows);
    double within = 0;
    for (std::size_t i = 0; i < fresh.rows; ++i) within += fresh_errors[i] <= lateral(fresh.row(i));
    held.push_back(within / static_cast<double>(fresh.rows));
  }
  CHECK(std::accumulate(held.begin(), held.end(), 0.0) / 200 == Approx(0.9).margin(0.03));
}

namespace {

// Returns the radar response of the plate records with the width multiplied by `times`.
record::RadarResponse bell(double times) {
  record::RadarResponse out{0.5, {}};
  for (int k = 0; k < 24; ++k) out.taps.push_back(std::exp(-std::pow(k * 0.125 / 0.4 / times, 2)));
  return out;
}

}  // namespace

TEST_CASE("records with a wider response are rarely flagged, and intervals cover most errors") {
  Dataset training = load_plates(800);
  training.sources[0].response.radar = bell(1);
  TrainOptions options = quiet_options("factorised-4");
  options.uncertainty = true, options.split.validation_share = 0.3;
  const TrainedModel model = train(training, options);
  for (const double times : {1.2, 1.5, 1.8}) {
    CAPTURE(times);
    Rng rng = make_rng(3, 3);
    std::normal_distribution<float> noise(0, 0.002f);
    Dataset data = load_plates(400, 2);
    data.sources[0].response.radar = bell(1);
    ModelResponse response;
    response.radar = bell(times);
    response.convert(data);
    for (float& v : profiles(data).values) v += noise(rng);
    data.sources[0].response = {bell(times)};
    const UncertaintyCalibration c = calibration_of(model, data);
    CHECK(c.flagged < 0.05);
    CHECK(c.within_90 > 0.8);
  }
}

TEST_CASE("the lateral interval includes the range error, or a note reports what is missing") {
  const Dataset plain = load_plates(40, 2);
  const Records records = prepare_records(trained(), plain);
  CHECK_THAT(records.ranges, Contains("does not contain a calibration of both sensors"));
  const auto assumed = uncertainties_of(records.data);

  Dataset calibrated = plain;
  calibrated.sources[0].calibration_error_m = 0.008;
  CHECK_THAT(prepare_records(trained(), calibrated).ranges,
             Contains("does not contain radar_baseline_m"));
  calibrated.sources[0].mounting = {.baseline_m = 0.5, .tolerance_m = 0.006};
  const Records stated = prepare_records(trained(), calibrated);
  CHECK(stated.ranges.empty());
  const Prediction p = predict(trained(), stated.data, all_rows(40));
  for (std::size_t i = 0; i < 40; ++i) {
    const double before_m = assumed[i].lateral_interval_90_m,
                 after_m = p.uncertainties[i].lateral_interval_90_m;
    if (std::isnan(before_m)) continue;
    const BodyPlace body = body_place(p.maps.row(i), trained().first().scene);
    CHECK(after_m ==
          Approx(std::hypot(before_m, 1.645 * 0.01 * std::hypot(body.x_m, body.z_m) / 0.5)));
  }
}

TEST_CASE("the range error of a run joins both calibration errors and the mounting tolerance") {
  const Folder dir;
  a_run(3).offset(Sensor::spd, 0, 0.003).offset(Sensor::radar, 0, 0.004).write(dir / "both");
  a_run(3, 2).offset(Sensor::radar, 0, 0.004).write(dir / "one");
  const Source both = load({dir / "both"}).sources[0], one = load({dir / "one"}).sources[0];
  CHECK(both.calibration_error_m.value() == Approx(0.005));
  CHECK(both.range_error_m() == Approx(std::hypot(0.005, 0.003)));
  CHECK_FALSE(one.calibration_error_m);
  CHECK(one.range_error_m() == 0.003);
  using record::RadarMounting, record::radar_mounting_of;
  const auto values = [](const RadarMounting& m) { return std::pair(m.baseline_m, m.tolerance_m); };
  CHECK(values(radar_mounting_of(RadarMounting{0.52, 0.01}.meta())) == std::pair(0.52, 0.01));
  CHECK(values(radar_mounting_of({{"radar_baseline_m", "half"},
                                  {"radar_mount_tolerance_m", "0.2"}})) == std::pair(0., 0.003));
}

TEST_CASE("single-sensor models flag outliers") {
  for (const std::string inputs : {"spd", "radar"}) {
    CAPTURE(inputs);
    const TrainedModel model =
        trained_model("ridge", 400, {"--inputs", inputs, "--set", "validation_share=0.3"});
    Dataset data = load_plates(200, 2);
    const Rows rows = all_rows(200);
    CHECK(share_flagged(predict(model, data, rows).uncertainties) < 0.04);
    Rng rng = make_rng(6, 6);
    std::poisson_distribution<int> dark(50);
    for (Matrix* table : {&photons(data), &profiles(data)})
      for (float& v : table->values) v = static_cast<float>(dark(rng));
    CHECK(share_flagged(predict(model, data, rows).uncertainties) > 0.95);
  }
}

TEST_CASE("pixel uncertainty matches the depth errors, and the expected depth has a low RMSE") {
  const Dataset data = load_plates(300, 2);
  const Rows rows = all_rows(300);
  for (const std::string name : {"factorised-4", "ridge"}) {
    CAPTURE(name);
    const TrainedModel model = trained_model(name, 800, more_validation);
    const UncertaintyCalibration c = calibration_of(model, data);
    CHECK(c.deviation_m == Approx(c.error_m).epsilon(0.15));
    const Prediction made = predict(model, data, rows, PredictionDetail::pixels);
    const auto rmse = [&](const Matrix& maps) {
      return summarise(score_maps(maps, data, rows, model.first().scene))[metric_rmse_m].mean;
    };
    // The position of a plate is known to less than a pixel, so averaging over positions hardly
    // changes the depth error.
    CHECK(rmse(made.mean) < (name == "ridge" ? 1.0 : 1.1) * rmse(made.maps));
  }
}

TEST_CASE("the expected depth in an empty room is the depth of the wall") {
  const Dataset walled = load_plates(300, 1, [](FusedRecord& r) {
    std::ranges::replace(depth_mm(r), 0, 5000);
    // The SPD does not detect one object in ten, so the model learns that an object may be
    // outside the predicted mask.
    for (std::size_t i = 0; i < counts(r).size() && r.index % 10 == 0; ++i)
      counts(r)[i] = 3 + i % 2;
  });
  TrainOptions options = quiet_options("factorised-4");
  options.uncertainty = true, options.split.validation_share = 0.3;
  const TrainedModel model = train(walled, options);
  Dataset empty = load_plates(3, 2);
  for (std::size_t i = 0; i < photons(empty).values.size(); ++i)
    photons(empty).values[i] = static_cast<float>(3 + i % 2);
  const Prediction a = predict(model, empty, all_rows(3), PredictionDetail::pixels);
  for (const float z : a.mean.values) REQUIRE(z == Approx(5.0f).margin(1e-3));
}

TEST_CASE("a model of 90 records has a cross-fitted uncertainty, and a model of 40 has none") {
  const ReconFolder dir;
  a_run(90).write(dir / "few"), a_run(40).write(dir / "fewer"), a_run(60, 2).write(dir / "fresh");
  const std::string train = "train -q --set fallback=false --model factorised-2 --epochs 20 ";
  for (const std::string run : {"few", "fewer"}) dir.done(train + run + " --out " + run + ".h5");
  const TrainedModel model = load_model(dir / "few.h5");
  REQUIRE(model.first().uncertainty);
  CHECK(calibration_of(model, load_plates(300, 2)).within_90 == Approx(0.9).margin(0.1));
  CHECK(share_flagged(predict(model, load_plates(300, 2), all_rows(300)).uncertainties) < 0.08);
  const TrainedModel without = load_model(dir / "fewer.h5");
  CHECK_FALSE(without.first().uncertainty);
  CHECK(predict(without, load_plates(20, 2), all_rows(20)).uncertainties.empty());
  CHECK_THROWS_WITH(predict(without, load_plates(20, 2), all_rows(20), PredictionDetail::pixels),
                    Contains("the model is not calibrated"));
  dir.says("reconstruct fewer.h5 fresh --out o --format npy",
           {"not calibrated: calibration needs a model with sensor inputs"});
  CHECK_THAT(contents(dir / "o/records.csv"), Contains(",,,,,not calibrated\n"));
  CHECK_THAT(contents(dir / "o/run.txt"), EndsWith("not calibrated\n"));
  dir.says("evaluate fewer.h5 fresh", {"not calibrated"});
}

TEST_CASE("reconstruct and evaluate report the uncertainty of the predictions") {
  const ReconFolder dir;
  save_model(trained(), dir / "m");
  a_run(40, 3, [](FusedRecord& r) {
    for (std::size_t i = 0; i < counts(r).size() && r.index == 5; ++i) counts(r)[i] = 3 + i % 2;
  }).write(dir / "run");
  dir.says("reconstruct m run --out o --format uncertainty,npy",
           {"of 40 records are out of distribution: ", "1 empty"});
  const std::string table = contents(dir / "o/records.csv");
  CHECK_THAT(table, StartsWith("record,status,after_slot_s,x_m,z_m,lateral_interval_90_m,"
                               "distance,two_bodies,out_of_distribution,uncertainty\n"));
  CHECK_THAT(table, Contains("\n5,\"ok\",,,") && Contains(",\"empty\",calibrated\n"));
  // A pixel at the edge of a plate at 3500 mm may show either the plate or the background, so its
  // standard deviation is large.
  const auto most = std::ranges::max(picture(dir / "o/000007_sd.png"));
  CHECK((most > 300 && most < 2500));
  CHECK(std::filesystem::file_size(dir / "o/deviation.npy") > 40 * 64 * 64 * 4);
  const auto calibration = dir.json("evaluate m run")["calibration"];
  CHECK(calibration["within_lateral_interval_90"] > 0.7);
  CHECK(calibration["flagged"] >= 1 / 40.0);
}

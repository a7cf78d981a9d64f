// SPDX-License-Identifier: MIT
#include "recon/trust/domain_shift.hpp"

#include "recon/numbers/statistics.hpp"
#include "world.hpp"

namespace {

TrainedModel trained(const std::string& name, const std::string& inputs) {
  return trained_model(name, 400, {"--inputs", inputs});
}

DomainShift shift_of(const TrainedModel& model, const Dataset& data) {
  return domain_shift_of(model, prepare_records(model, data).data);
}

// Adds a share of each bin's power to the next bin.
void blur(std::vector<float>& profile, float share = 1.f / 3) {
  for (std::size_t i = profile.size() - 1; i > 0; --i) profile[i] += share * profile[i - 1];
}

// Replaces the data with noise like that measured in an empty room by working sensors.
const Change without_body = [](FusedRecord& r) {
  Rng rng = make_rng(7, static_cast<std::uint64_t>(r.index));
  for (auto& v : counts(r)) v = 15 + static_cast<std::uint32_t>(rng() % 10);
  for (float& v : power(r)) v = 1 + static_cast<float>(rng() % 100) / 100;
};

const Change blurred = [](FusedRecord& r) { blur(power(r)); };

}  // namespace

TEST_CASE("the domain-shift test detects changed runs and accepts unchanged runs") {
  for (const auto& [name, inputs] : {std::pair{"mean-shape", "fused"}, {"ridge", "radar"}}) {
    CAPTURE(inputs);
    const TrainedModel& model = trained(name, inputs);
    int alarms = 0;
    for (std::uint64_t seed = 10; seed < 14; ++seed) {
      const DomainShift own = shift_of(model, load_plates(100, seed));
      const DomainShift other = shift_of(model, load_plates(100, seed + 100, blurred));
      alarms += own.found();
      CHECK_THAT(own.text(), Catch::StartsWith("this run matches the training data: p = "));
      CHECK(other.found());
      // The test statistic of the run is larger than in all 4000 permutations, so p = 1 / (4000 +
      // 1).
      CHECK(other.p == Approx(1. / 4001));
      CHECK_THAT(other.text(), Catch::StartsWith("this run differs from the training data: ") &&
                                   Catch::Contains("p < 0.001: ") && Catch::Contains("radar"));
    }
    CHECK(alarms == 0);
  }
}

TEST_CASE("the domain-shift test ignores sensor gains and skips runs with few records") {
  const TrainedModel& model = trained("mean-shape", "fused");
  CHECK_FALSE(shift_of(model, load_plates(100, 10,
                                          [](FusedRecord& r) {
                                            for (float& v : power(r)) v *= 5;
                                            for (auto& v : counts(r)) v *= 3;
                                          }))
                  .found());
  CHECK_FALSE(shift_of(model, load_plates(15, 11)).tested());
  CHECK(shift_of(model, load_plates(15, 11)).text().empty());
}

TEST_CASE("a run with mostly flagged records is reported as different from the training data") {
  const TrainedModel& model = trained("mean-shape", "fused");
  const DomainShift all = shift_of(model, load_plates(30, 10, without_body));
  CAPTURE(all.text(), all.flagged, all.assessed);
  CHECK(all.found());
  CHECK_THAT(all.text(), Catch::StartsWith("this run differs from the training data: ") &&
                             Catch::Contains("of 30 records are unusual ("));
  const DomainShift half = shift_of(model, load_plates(60, 11, [&](FusedRecord& r) {
                                      if (r.index % 3 == 0) without_body(r);
                                    }));
  CHECK(half.flagged >= 20);
  CHECK_FALSE(half.mostly_flagged());
  CHECK_FALSE(shift_of(model, load_plates(19, 10, without_body)).found());
}

TEST_CASE("records are flagged as saturated or empty only if the training records are not") {
  const auto reasons = [](const Dataset& training, const Dataset& fresh) {
    TrainOptions options = quiet_options("ridge");
    options.uncertainty = true;
    const TrainedModel model = train(training, options);
    std::vector<std::string> out;
    for (const auto& u :
         recon::predict(model, fresh, all_rows(fresh.size()), PredictionDetail::uncertainty)
             .uncertainties)
      out.push_back(u.out_of_distribution.reason);
    return out;
  };
  Dataset training = load_plates(200, 1), fresh = load_plates(3, 2);
  for (RecordInfo& info : training.records) info.clicks_per_pulse = 0.2;
  for (std::size_t i = 0; const double clicks : {0.2, 0.24, 0.3})
    fresh.records[i++].clicks_per_pulse = clicks;
  const auto bright = reasons(training, fresh);
  CHECK(bright[0] != "saturated");
  // 0.24 clicks per pulse is less than 25 % above the 0.2 clicks per pulse of the brightest
  // training record.
  CHECK(bright[1] != "saturated");
  CHECK(bright[2] == "saturated");
  const Dataset none = load_plates(3, 3, without_body);
  CHECK(reasons(load_plates(200, 1), none)[0] == "empty");
  const Change often = [](FusedRecord& r) {
    if (r.index % 3 == 0) without_body(r);
  };
  CHECK(reasons(load_plates(200, 1, often), none)[0] != "empty");
}

TEST_CASE("the domain-shift test reports a 1 % wider radar profile in a run of 400 records") {
  const DomainShift slight =
      shift_of(trained("mean-shape", "fused"),
               load_plates(400, 77, [](FusedRecord& r) { blur(power(r), 0.025f); }));
  CHECK(slight.found());
  CHECK_THAT(slight.text(), Catch::Contains("radar profile width 1.01 +- 0.00 times"));
}

TEST_CASE("the 90 % intervals of a run are widened by its difference from the training data") {
  const TrainedModel& model = trained("mean-shape", "fused");
  const Records like = prepare_records(model, load_plates(100, 10));
  CHECK(domain_shift_of(model, like.data).interval_factor < 1.05);
  const auto shifted = [&](double by_m) {
    return prepare_records(model, load_plates(100, 10), by_m);
  };
  double last = 1;
  for (const double by_m : {0.05, 0.1, 0.2}) {
    const DomainShift shift = domain_shift_of(model, shifted(by_m).data);
    CHECK(shift.interval_factor > last);
    CHECK_THAT(shift.text(), Catch::Contains(" times as wide"));
    last = shift.interval_factor;
  }
  const Records run = shifted(0.05);
  const Evaluation e = evaluate(model, run, all_rows(100));

  // The file records.csv contains the widened intervals, also if only some records are asked for.
  const ReconFolder dir;
  save_model(model, dir / "m");
  a_run(100, 10).write(dir / "run");
  for (const std::string asked : {"", " --rows 3,7,50,51,52,53,54,55"}) {
    CHECK_THAT(dir.done("reconstruct -q --force --range-offset 0.05 m run" + asked + " --out maps"),
               Catch::Contains(" times as wide"));
    std::ifstream table(dir / "maps/records.csv");
    std::string line;
    std::size_t compared = 0;
    while (std::getline(table, line)) {
      long long index = 0;
      double x = 0, z = 0, interval_m = 0;
      if (std::sscanf(line.c_str(), R"(%lld,"ok",,%lf,%lf,%lf)", &index, &x, &z, &interval_m) != 4)
        continue;
      CHECK(interval_m ==
            Approx(e.uncertainties[static_cast<std::size_t>(index)].lateral_interval_90_m)
                .margin(0.0006));
      ++compared;
    }
    CHECK(compared > 5);
  }
}

TEST_CASE("evaluate widens all 90 % intervals of a run by the same factor") {
  const TrainedModel& model = trained("mean-shape", "fused");
  Dataset data = load_plates(100, 10);
  // The maps of these records are not those of the usual estimator, because the radar is missing.
  for (std::size_t row = 0; row < 10; ++row) data.records[row].valid.erase(Sensor::radar);
  const Records run = prepare_records(model, std::move(data), 0.05);
  const Rows rows = all_rows(100);
  const auto plain =
      recon::predict(model, run.data, rows, PredictionDetail::uncertainty).uncertainties;
  const Evaluation e = evaluate(model, run, rows);
  REQUIRE(e.domain_shift.interval_factor > 1);
  std::size_t widened = 0;
  for (std::size_t i = 0; i < 100; ++i) {
    if (std::isnan(plain[i].lateral_interval_90_m)) continue;
    ++widened;
    CHECK(e.uncertainties[i].lateral_interval_90_m ==
          Approx(plain[i].lateral_interval_90_m * e.domain_shift.interval_factor));
  }
  CHECK(widened > 20);
}

TEST_CASE("the domain-shift test measures radar power out to half the range of the body") {
  const TrainedModel& model = trained("ridge", "radar");
  // The echoes of the plates begin in bin 12.
  const auto said = [&](std::size_t from, std::size_t to) {
    const DomainShift shift = shift_of(model, load_plates(100, 10, [=](FusedRecord& r) {
                                         for (std::size_t i = from; i < to; ++i)
                                           power(r)[i] += 0.3f;
                                       }));
    CHECK(shift.found());
    return shift.text();
  };
  const std::string name = "radar power before the body";
  CHECK_THAT(said(0, 6), Catch::Contains(name));
  CHECK_THAT(said(9, 11), !Catch::Contains(name));
}

TEST_CASE("transmitter leakage below 1 m makes neither a record nor a run unusual") {
  const TrainedModel model = trained("ridge", "fused");
  const Dataset data = load_plates(100, 10, [](FusedRecord& r) {
    for (std::size_t i = 0; i < 4; ++i) power(r)[i] += 3;
  });
  const Records records = prepare_records(model, data);
  CHECK_THAT(shift_of(model, data).text(), Catch::StartsWith("this run matches"));
  CHECK(share_flagged(predict(model, records.data, all_rows(100)).uncertainties) < 0.04);
}

TEST_CASE("the domain-shift test derives standard errors from the variance between record blocks") {
  // The reference consists of six blocks of ten records. The new run consists of two such blocks.
  const std::size_t known = 60, count = 20;
  const Dataset all = load_plates(known + count, 50, [&](FusedRecord& r) {
    // In the new run, the plates are 48 cm (8 bins of 6 cm) nearer than in the reference.
    if (r.index >= std::int64_t(known))
      std::rotate(counts(r).begin(), counts(r).begin() + 8, counts(r).end());
  });
  const Rows rows = all_rows(all.size()), before(rows.begin(), rows.begin() + known),
             now(rows.begin() + known, rows.end());
  const Preprocessing p(all, before, Inputs::fused, learn_scene(depth_maps(all), before, all.map),
                        true);
  const Matrix views = take_rows(p.views, now);
  const Dataset run = part_of(all, now);
  const DomainReference reference(p.alignment, all, p.views, before, Inputs::fused);
  // Returns the mean range of each block of ten records.
  const auto blocks = [](const Matrix& numbers) {
    std::vector<double> means(numbers.rows / 10);
    for (std::size_t i = 0; i < numbers.rows; ++i) means[i / 10] += double{numbers.row(i)[3]} / 10;
    return means;
  };
  const auto squares = [](const std::vector<double>& means) {
    double sum = 0;
    for (const double m : means) sum += std::pow(m - mean_of(means), 2);
    return sum;
  };
  const auto a = blocks(record_numbers_of(p.alignment, all, p.views, before, Inputs::fused)),
             b = blocks(record_numbers_of(p.alignment, run, views, all_rows(count), Inputs::fused));
  REQUIRE((a.size() == 6 && b.size() == 2));
  const double error = std::sqrt((squares(a) + squares(b)) / (6 + 2 - 2) * (1 / 6. + 1 / 2.));
  const auto found = reference.test(p.alignment, run, views).differences;
  const auto range = std::ranges::find_if(
      found, [](const DomainShift::Difference& d) { return d.text.starts_with("range "); });
  REQUIRE(range != found.end());
  CHECK(range->standard_errors == Approx(std::abs(mean_of(b) - mean_of(a)) / error).epsilon(1e-3));
}

TEST_CASE("the domain-shift test reports a radar range bias and the option that corrects it") {
  const TrainedModel& model = trained("mean-shape", "fused");
  // Moves the echo by one bin of 25 cm.
  const auto farther = [](FusedRecord& r) {
    std::rotate(power(r).begin(), power(r).end() - 1, power(r).end());
  };
  const DomainShift shift = shift_of(model, load_plates(200, 30, farther));
  CHECK(shift.found());
  CHECK_THAT(shift.text(),
             Catch::Contains("radar ranges are ") &&
                 Catch::Contains(" cm too long, or people are farther to the right or "
                                 "reflect differently than in training; if the radar is the "
                                 "cause, use --range-offset 0.2") &&
                 Catch::Contains("radar range +"));
  // Range bias and its standard error in cm. The first two values come from the list of
  // differences, the other two from the advice.
  double cm = 0, cm_error = 0, advised_cm = 0, advised_error = 0;
  const auto at = [&](const char* name) { return shift.text().substr(shift.text().find(name)); };
  CHECK(std::sscanf(at("radar range +").c_str(), "radar range %lf +- %lf", &cm, &cm_error) == 2);
  CHECK(std::sscanf(at("radar ranges are").c_str(), "radar ranges are %lf +- %lf", &advised_cm,
                    &advised_error) == 2);
  CHECK(cm == advised_cm);
  CHECK(cm_error == advised_error);
  // The radar profiles are also blurred, because the advice must be given even if other quantities
  // differ from the training data.
  const DomainShift more =
      shift_of(model, load_plates(200, 30, [&](FusedRecord& r) { farther(r), blur(power(r)); }));
  CHECK(more.differences.size() > 1);
  CHECK_THAT(more.text(), Catch::Contains("if the radar is the cause, use --range-offset "));
  CHECK_THAT(shift_of(model, load_plates(200, 31)).text(), !Catch::Contains("--range-offset"));
}

TEST_CASE("the domain-shift test raises few false alarms for small and large reference sets") {
  const Dataset all = load_plates(3000, 40);
  const Rows rows = all_rows(3000);
  for (const std::size_t known : {60, 1500}) {
    CAPTURE(known);
    const Preprocessing p(all, Rows(rows.begin(), rows.begin() + 1500), Inputs::fused,
                          learn_scene(depth_maps(all), rows, all.map), true);
    const DomainReference reference(p.alignment, all, p.views,
                                    Rows(rows.begin(), rows.begin() + std::ptrdiff_t(known)),
                                    Inputs::fused);
    int below_5_percent = 0;
    for (std::size_t first = 1500; first < 3000; first += 50) {
      const Rows some(rows.begin() + std::ptrdiff_t(first),
                      rows.begin() + std::ptrdiff_t(first + 50));
      const DomainShift shift =
          reference.test(p.alignment, part_of(all, some), take_rows(p.views, some));
      CHECK_FALSE(shift.found());
      below_5_percent += shift.p < 0.05;
    }
    // In a test of 30 runs, p is below 5 % in more than 5 runs by chance in only one of 300 tests.
    CHECK(below_5_percent <= 5);
  }
}

TEST_CASE("the domain-shift test excludes training records and their copies") {
  const ReconFolder dir;
  const std::string first = made_run(300);
  a_run(360).write(dir / "more");
  a_run(300, 1, [](FusedRecord& r) { r.label = "other"; }).write(dir / "copies");
  const std::string model_file = made_model("ridge", 300);
  const TrainedModel model = load_model(model_file);
  CHECK(shift_of(model, load_recorded({first})).records == 30);
  CHECK(shift_of(model, load_recorded({dir / "more"})).records == 60 + 30);
  CHECK(shift_of(model, load_recorded({dir / "copies"})).records == 30);
  CHECK_THAT(dir.recon("evaluate -q " + model_file + " " + first).text,
             Catch::Contains("\n" + first + ", held-out records: this run "));
  CHECK_THAT(dir.recon("evaluate -q " + model_file + " more").text,
             Catch::Contains("\nmore: this run "));
}

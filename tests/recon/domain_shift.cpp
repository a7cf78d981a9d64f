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
      CHECK_THAT(own.text(), StartsWith("this run matches the training data: p = "));
      CHECK(other.found());
      // The test statistic of the run is larger than in all 4000 permutations, so p = 1 / (4000 +
      // 1).
      CHECK(other.p == Approx(1. / 4001));
      CHECK_THAT(other.text(), StartsWith("this run differs from the training data: ") &&
                                   Contains("p < 0.001: ") && Contains("radar"));
    }
    CHECK(alarms == 0);
  }
}

TEST_CASE("the domain-shift test ignores sensor gains and leakage, and states what differs") {
  const TrainedModel &fused = trained("mean-shape", "fused"), &radar = trained("ridge", "radar");
  const Change gains = [](FusedRecord& r) {
    for (float& v : power(r)) v *= 5;
    for (auto& v : counts(r)) v *= 3;
  };
  const auto more_power = [](std::size_t from, std::size_t to, float more) {
    return [=](FusedRecord& r) {
      for (std::size_t i = from; i < to; ++i) power(r)[i] += more;
    };
  };
  const Change leakage = more_power(0, 4, 3),
               slight = [](FusedRecord&r) { blur(power(r), 0.025f); };
  const auto said = [](const TrainedModel& model, std::int64_t records, std::uint64_t seed,
                       const Change& change) {
    return shift_of(model, load_plates(records, seed, change)).text();
  };
  for (const Change& change : {gains, leakage})
    CHECK_THAT(said(fused, 100, 10, change), StartsWith("this run matches"));
  CHECK(said(fused, 15, 11, {}).empty());
  CHECK_THAT(said(fused, 400, 77, slight), Contains("radar profile width 1.01 +- 0.00 times"));
  // Every second body is 24 cm nearer, and the others are farther by as much.
  const Change spread = [](FusedRecord& r) {
    const std::ptrdiff_t near = r.index % 2;
    std::rotate(counts(r).begin(), near ? counts(r).begin() + 4 : counts(r).end() - 4,
                counts(r).end());
    std::rotate(power(r).begin(), near ? power(r).begin() + 1 : power(r).end() - 1, power(r).end());
  };
  CHECK_THAT(said(fused, 400, 12, spread), Contains(" scatters more"));
  // Power is measured out to half the range of the body. The echoes of the plates begin in bin 12.
  const std::string name = "radar power before the body";
  CHECK_THAT(said(radar, 100, 10, more_power(0, 6, 0.3f)), Contains(name));
  CHECK_THAT(said(radar, 100, 10, more_power(9, 11, 0.3f)),
             StartsWith("this run differs") && !Contains(name));
  const Records leaking = prepare_records(fused, load_plates(100, 10, leakage));
  CHECK(share_flagged(predict(fused, leaking.data, all_rows(100)).uncertainties) < 0.04);
}

TEST_CASE("a run with mostly flagged records is reported as different from the training data") {
  const TrainedModel& model = trained("mean-shape", "fused");
  const DomainShift all = shift_of(model, load_plates(30, 10, without_body));
  CAPTURE(all.text(), all.flagged, all.assessed);
  CHECK(all.found());
  CHECK_THAT(all.text(), StartsWith("this run differs from the training data: ") &&
                             Contains("of 30 records are unusual ("));
  const DomainShift half = shift_of(model, load_plates(60, 11, [&](FusedRecord& r) {
                                      if (r.index % 3 == 0) without_body(r);
                                    }));
  CHECK(half.flagged >= 20);
  CHECK_FALSE(half.mostly_flagged());
  CHECK_FALSE(shift_of(model, load_plates(19, 10, without_body)).found());
}

TEST_CASE("records are flagged as saturated or empty only if the training records are not") {
  const auto reasons = [](const Dataset& training, const Dataset& fresh) {
    Words out;
    for (const auto& score : outlier_scores(training, all_rows(training.size()), fresh))
      out.push_back(score.reason);
    return out;
  };
  const Dataset usual = load_plates(200, 1), none = load_plates(3, 3, without_body);
  Dataset training = usual, fresh = load_plates(3, 2);
  for (RecordInfo& info : training.records) info.clicks_per_pulse = 0.2;
  for (std::size_t i = 0; const double clicks : {0.2, 0.24, 0.3})
    fresh.records[i++].clicks_per_pulse = clicks;
  const auto bright = reasons(training, fresh);
  CHECK(bright[0] != "saturated");
  // 0.24 clicks per pulse is less than 25 % above the 0.2 clicks per pulse of the brightest
  // training record.
  CHECK(bright[1] != "saturated");
  CHECK(bright[2] == "saturated");
  CHECK(reasons(usual, none)[0] == "empty");
  const Dataset often = load_plates(200, 1, [](FusedRecord& r) {
    if (r.index % 3 == 0) without_body(r);
  });
  CHECK(reasons(often, none)[0] != "empty");
}

TEST_CASE("the 90 % intervals of a run are widened by its difference from the training data") {
  const TrainedModel& model = trained("mean-shape", "fused");
  const ReconFolder dir;
  save_model(model, dir / "m");
  // The model predicts no maps for the records without radar data.
  a_run(100, 10, [](FusedRecord& r) {
    if (r.index < 10) lose(r, Sensor::radar);
  }).write(dir / "run");
  const Dataset data = load_recorded({dir / "run"});
  CHECK(domain_shift_of(model, prepare_records(model, data).data).interval_factor < 1.05);
  double last = 1;
  std::vector<double> expected_m;
  for (const double by_m : {0.2, 0.1, 0.05}) {
    const Records run = prepare_records(model, data, by_m);
    const auto plain =
        predict(model, run.data, all_rows(100), PredictionDetail::uncertainty).uncertainties;
    const Evaluation e = evaluate(model, run, all_rows(100));
    const double factor = e.domain_shift.interval_factor;
    CHECK_THAT(e.domain_shift.text(), Contains(" times as wide"));
    CHECK((factor > 1 && (factor < last || by_m == 0.2)));
    last = factor;
    expected_m.clear();
    for (std::size_t i = 0; i < 100; ++i) {
      expected_m.push_back(e.uncertainties[i].lateral_interval_90_m);
      if (!std::isnan(plain[i].lateral_interval_90_m))
        CHECK(expected_m[i] == Approx(plain[i].lateral_interval_90_m * factor));
    }
    CHECK(std::ranges::count_if(expected_m, [](double m) { return m > 0; }) > 20);
  }
  // The file records.csv contains the widened intervals, also if only some records are asked for.
  for (const std::string asked : {"", " --rows 3,7,50,51,52,53,54,55"}) {
    dir.says("reconstruct -q --force --range-offset 0.05 m run" + asked + " --out maps",
             {" times as wide"}, 5);
    std::ifstream table(dir / "maps/records.csv");
    std::size_t compared = 0;
    for (std::string line; std::getline(table, line);) {
      long long index = 0;
      double x = 0, z = 0, interval_m = 0;
      if (std::sscanf(line.c_str(), R"(%lld,"ok",,%lf,%lf,%lf)", &index, &x, &z, &interval_m) != 4)
        continue;
      CHECK(interval_m == Approx(expected_m[static_cast<std::size_t>(index)]).margin(0.0006));
      ++compared;
    }
    CHECK(compared > 5);
  }
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
  const std::string text = shift.text();
  CHECK(shift.found());
  CHECK_THAT(text,
             Contains(" cm too long, or people are farther to the right or reflect differently "
                      "than in training; if the radar is the cause, use --range-offset 0.2"));
  // The advice states the same bias and standard error as the list of differences.
  const auto bias = [&](const std::string& name) {
    const auto at = text.find(name);
    REQUIRE(at != std::string::npos);
    return text.substr(at + name.size(), text.find(" cm", at) - at - name.size());
  };
  CHECK(bias("radar range +") == bias("radar ranges are "));
  // The radar profiles are also blurred, because the advice must be given even if other quantities
  // differ from the training data.
  const DomainShift more =
      shift_of(model, load_plates(200, 30, [&](FusedRecord& r) { farther(r), blur(power(r)); }));
  CHECK(more.differences.size() > 1);
  CHECK_THAT(more.text(), Contains("if the radar is the cause, use --range-offset "));
  CHECK_THAT(shift_of(model, load_plates(200, 31)).text(), !Contains("--range-offset"));
}

TEST_CASE("the domain-shift test excludes training records and their copies") {
  const ReconFolder dir;
  const std::string first = made_run(300), model_file = made_model("ridge", 300);
  a_run(360).write(dir / "more");
  a_run(300, 1, [](FusedRecord& r) { r.label = "other"; }).write(dir / "copies");
  const TrainedModel model = load_model(model_file);
  for (const auto& [run, records] : {std::pair<std::string, std::size_t>{first, 30},
                                     {dir / "more", 60 + 30},
                                     {dir / "copies", 30}})
    CHECK(shift_of(model, load_recorded({run})).records == records);
  dir.says("evaluate -q " + model_file + " " + first,
           {"\n" + first + ", held-out records: this run "});
  dir.says("evaluate -q " + model_file + " more", {"\nmore: this run "});
}

// SPDX-License-Identifier: MIT
#include "recon/uncertainty/two_bodies.hpp"

#include "recon/estimator/evaluate.hpp"
#include "recon/estimator/predict.hpp"
#include "recon/estimator/train.hpp"
#include "recon/maps/people.hpp"
#include "recon/models/body/split_bodies.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using echofuse::testing::contents;
using echofuse::testing::Folder;
using echofuse::testing::recon_program;
using echofuse::testing::write_run;

namespace {

struct Plate {
  double x, z;
};
// Longer than the plates need: else two of them fill half of the bins, and there is no background.
Axis long_axis() {
  Axis axis = testing::spd_axis();
  axis.count *= 3;
  return axis;
}
record::FusedRecord record_of(std::int64_t index, const Plate& p, Rng& rng) {
  record::FusedRecord out = testing::plate_record(index, p.x, p.z, rng);
  out.spd.resize(long_axis().count);
  return out;
}

constexpr Plate near_left{-0.6, 3.05}, far_right{0.5, 3.85};

// What both measure if neither hides the other; of the map, what the nearer one leaves.
void add(record::FusedRecord& to, const record::FusedRecord& other) {
  for (std::size_t i = 0; i < to.spd.size(); ++i) to.spd[i] += other.spd[i];
  for (std::size_t i = 0; i < to.radar.size(); ++i) to.radar[i] += other.radar[i];
  for (std::size_t p = 0; p < to.depth_mm.size(); ++p)
    if (to.depth_mm[p] == 0 || (other.depth_mm[p] > 0 && other.depth_mm[p] < to.depth_mm[p]))
      to.depth_mm[p] = other.depth_mm[p];
  to.label = two_people_label;
}

// One plate in every other record; in the others two, one behind the other or side by side.
void write_mixed(const std::string& path, std::int64_t count, bool behind) {
  Rng rng = make_rng(9, 9);
  std::uniform_real_distribution<double> off(-0.1, 0.1);
  write_run(
      path, count, 5,
      [&](record::FusedRecord& r) {
        if (r.index % 2) return;
        const std::int64_t index = r.index;
        const double far_z = behind ? far_right.z : near_left.z;
        r = record_of(index, {near_left.x + off(rng), near_left.z + off(rng) / 4}, rng);
        add(r, record_of(index, {far_right.x + off(rng), far_z + off(rng) / 4}, rng));
      },
      testing::radar_axis(), long_axis());
}

Dataset mixed(std::int64_t count, bool behind) {
  const Folder dir;
  write_mixed(dir / "run", count, behind);
  return load({dir / "run"});
}

const TrainedModel& trained() {
  static const TrainedModel model = [] {
    TrainOptions options;
    options.model = "factorised-4";
    options.split.validation_share = 0.3;
    options.fit.quiet = true;
    options.fallback = false;
    const Folder dir;
    write_run(dir / "plates", 600, 1, {}, testing::radar_axis(), long_axis());
    return train(load({dir / "plates"}), options);
  }();
  return model;
}

std::vector<float> raw_of(const std::vector<Plate>& plates) {
  Rng rng = make_rng(3, 3);
  record::FusedRecord sum = record_of(0, plates[0], rng);
  for (std::size_t i = 1; i < plates.size(); ++i) add(sum, record_of(0, plates[i], rng));
  std::vector<float> raw(sum.spd.begin(), sum.spd.end());
  raw.insert(raw.end(), sum.radar.begin(), sum.radar.end());
  return raw;
}

double area_under_roc(const std::vector<double>& one, const std::vector<double>& two) {
  double right = 0;
  for (const double a : one)
    for (const double b : two) right += b > a;
  return right / static_cast<double>(one.size() * two.size());
}

double shift_m(const Plate& p) { return std::hypot(p.x + 0.5, p.z) - std::hypot(p.x, p.z); }

}  // namespace

TEST_CASE("the sum of two records comes apart, nearer first, with a range and a shift each") {
  const auto split = split_bodies(trained().alignment, raw_of({far_right, near_left}));
  REQUIRE(split);
  const std::array truth{near_left, far_right};
  for (std::size_t k = 0; k < 2; ++k) {
    CAPTURE(k);
    CHECK(split->parts[k].range_m == Approx(std::hypot(truth[k].x, truth[k].z)).margin(0.03));
    CHECK(split->parts[k].shift_m == Approx(shift_m(truth[k])).margin(0.06));
  }
  CHECK_FALSE(split_bodies(trained().alignment, raw_of({far_right})));
  // Nearer to each other than the radar resolves.
  CHECK_FALSE(split_bodies(trained().alignment, raw_of({far_right, {-0.6, 3.5}})));
}

TEST_CASE("two people are told from one, and both are in the map where range separates them") {
  const Dataset data = mixed(120, true);
  const Rows rows = all_rows(data.size());
  const Prediction made = predict(trained(), data, rows);
  std::size_t separated = 0, others = 0, placed = 0;
  for (const std::size_t i : rows) {
    const PredictionUncertainty& stated = made.uncertainties[i];
    (i % 2 ? others : separated) += stated.bodies.size() == 2;
    if (i % 2 || stated.bodies.empty()) continue;
    CHECK(stated.note == "two bodies");
    CHECK(stated.out_of_distribution.text().empty());
    const std::array truth{near_left, far_right};
    for (std::size_t k = 0; k < 2; ++k) {
      CAPTURE(i, k);
      placed += std::abs(stated.bodies[k].x_m - truth[k].x) < 0.3;
      CHECK(stated.bodies[k].z_m == Approx(truth[k].z).margin(0.1));
      CHECK(stated.bodies[k].lateral_interval_90_m > 0);
    }
  }
  CHECK(separated >= 57);
  CHECK(placed > 105);  // of 120
  CHECK(others == 0);
  const Evaluation e =
      evaluate(trained(), prepare_records(trained(), data, RangeBiasAction::ignore), rows);
  CHECK(e.two_people.records == 60);
  CHECK(e.two_people.separated == separated);
  CHECK(e.metrics[metric_iou_person].maps == 60);
  CHECK(e.metrics[metric_iou_person].mean > 0.5);
}

TEST_CASE("side by side they are flagged, and one body's map stays as it is bit by bit") {
  const Dataset data = mixed(120, false);
  const Rows rows = all_rows(data.size());
  const Prediction made = predict(trained(), data, rows);
  const Prediction plain = predict(trained(), data, rows, PredictionDetail::maps);
  CHECK(made.maps.values == plain.maps.values);
  std::vector<double> one, two;
  std::size_t refused = 0;
  for (const std::size_t i : rows) {
    const OutOfDistributionScore& s = made.uncertainties[i].out_of_distribution;
    (i % 2 ? one : two).push_back(s.two_bodies);
    if (i % 2 == 0) refused += s.text() == "two bodies, not separable";
  }
  CHECK(refused > 50);
  CHECK(area_under_roc(one, two) > 0.98);
}

TEST_CASE("where gains are stable, twice the light tells of a second body in the same place") {
  const Folder dir;
  write_run(dir / "plates", 400, 1, {}, testing::radar_axis(), long_axis());
  write_run(
      dir / "doubled", 120, 5,
      [](record::FusedRecord& r) {
        if (r.index % 2 == 0) add(r, record::FusedRecord(r));
      },
      testing::radar_axis(), long_axis());
  const Dataset data = load({dir / "doubled"});
  const Rows rows = all_rows(data.size());
  const auto area = [&](Gains gains, bool forgotten) {
    TrainOptions options;
    options.model = "factorised-4";
    options.split.validation_share = 0.3;
    options.fit.quiet = true, options.fit.epochs = 2;
    options.fallback = false, options.gains = gains;
    TrainedModel model = train(load({dir / "plates"}), options);
    save_model(model, dir / "a.h5"), model = load_model(dir / "a.h5");
    Matrix aligned = model.align(data, rows, true);
    if (forgotten) forget_brightness(model.alignment, aligned);
    std::vector<double> one, two;
    const auto scores = model.uncertainty->detector.judge(aligned, data, rows);
    for (const std::size_t i : rows) (i % 2 ? one : two).push_back(scores[i].two_bodies);
    return area_under_roc(one, two);
  };
  CHECK(area(Gains::unknown, false) < 0.7);
  CHECK(area(Gains::stable, true) < 0.7);
  CHECK(area(Gains::stable, false) > 0.95);
}

TEST_CASE("of a radar alone, the room is in a record of two people once") {
  constexpr std::size_t count = 300, wall_bin = 22;
  const auto with_wall = [](Dataset data) {
    for (std::size_t i = 0; i < data.size(); ++i) data.radar.row(i)[wall_bin] += 3;
    return data;
  };
  const Dataset bare = testing::load_plates(2 * count), all = with_wall(bare);
  Rows rows = all_rows(count);
  const Preprocessing p(all, rows, Inputs::radar, learn_scene(all.depth, rows, all.map), false);
  const OutOfDistributionDetector detector(p.alignment, all, p.aligned, rows, Inputs::radar,
                                           p.scene, 1);
  for (std::size_t& row : rows) row += count;
  const Dataset fresh = part_of(all, rows);
  Dataset two = fresh;
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t c = 0; c < two.radar.cols; ++c)
      two.radar.row(i)[c] += bare.radar.row(count + (i + 7) % count)[c];
  const auto scores_of = [&](const Dataset& of) {
    std::vector<double> out;
    for (const auto& s : detector.judge(p.aligned, of, all_rows(count)))
      out.push_back(s.two_bodies);
    return out;
  };
  CHECK(area_under_roc(scores_of(fresh), scores_of(two)) > 0.8);
}

TEST_CASE("records of two among the training records do not raise the limit, or are all of them") {
  const std::size_t count = 400;
  Dataset data = testing::load_plates(count);
  const Dataset bare = data;
  const auto add_other = [&](Dataset& to, std::size_t i) {
    for (const auto& [table, from] : {std::pair(&to.spd, &bare.spd), {&to.radar, &bare.radar}})
      for (std::size_t c = 0; c < table->cols; ++c)
        table->row(i)[c] += from->row((i + 7) % count)[c];
  };
  for (std::size_t i = 0; i < count; i += 5) add_other(data, i), data.label[i] = two_people_label;
  const Rows rows = all_rows(count);
  const auto judged = [&](const Dataset& training, Inputs inputs, const Dataset& of) {
    const Preprocessing p(training, rows, inputs, learn_scene(training.depth, rows, training.map),
                          inputs == Inputs::fused);
    const OutOfDistributionDetector detector(p.alignment, training, p.aligned, rows, inputs,
                                             p.scene, 1);
    const Matrix raw = fit_features(training, rows, inputs, raw_scaling).raw_inputs(of, rows);
    return detector.judge(inputs == Inputs::fused ? p.alignment(raw) : p.aligned, of, rows);
  };
  Dataset two = bare;
  for (std::size_t i = 0; i < count; ++i) add_other(two, i);
  const auto scores = judged(data, Inputs::fused, two);
  const auto flagged =
      std::count_if(scores.begin(), scores.end(), [](const auto& s) { return !s.reason.empty(); });
  INFO(flagged);
  CHECK(flagged > 200);
  std::fill(two.label.begin(), two.label.end(), two_people_label);
  for (const auto& s : judged(two, Inputs::radar, two)) CHECK(std::isnan(s.two_bodies));
}

TEST_CASE("each person of a map has an IoU of his own") {
  const Scene scene{std::vector<float>(64 * 64), std::vector<float>(64 * 64), 3.5f, {}};
  std::vector<float> truth(64 * 64), left(64 * 64);
  for (std::size_t row = 20; row < 40; ++row)
    for (std::size_t c = 0; c < 20; ++c) {
      truth[row * 64 + 12 + c] = left[row * 64 + 12 + c] = 3.2f;
      if (c < 10) truth[row * 64 + 32 + c] = 3.9f;  // they touch in the picture
    }
  const auto people = find_people(truth, scene);
  REQUIRE(people);
  CHECK(std::count(people->person.begin(), people->person.end(), 1) == 400);
  CHECK(std::count(people->person.begin(), people->person.end(), 2) == 200);
  CHECK(people->middle[1].z_m == Approx(3.9));
  CHECK(iou_per_person(truth, *people, scene) == 1);
  CHECK(iou_per_person(left, *people, scene) == 0.5);
  std::vector<float> half = truth;
  std::fill(half.begin(), half.begin() + 30 * 64, 0.f);
  CHECK(iou_per_person(half, *people, scene) == 0.5);
  CHECK(iou_per_person(scene.background, *people, scene) == 0);
  CHECK_FALSE(find_people(scene.background, scene));
}

TEST_CASE("reconstruct and evaluate say which records show two bodies, and where the second is") {
  const Folder dir;
  save_model(trained(), dir / "m");
  write_mixed(dir / "run", 20, true);
  const auto o = recon_program("reconstruct " + (dir / "m") + " " + (dir / "run") + " --out " +
                               (dir / "o") + " --format npz");
  CHECK(o.code == 0);
  CHECK_THAT(o.text, Catch::Contains("10 with two bodies"));
  const std::string table = contents(dir / "o/records.csv");
  CHECK_THAT(table, Catch::Contains("uncertainty,bodies,second_x_m,second_z_m,"
                                    "second_lateral_interval_90_m\n") &&
                        Catch::Contains("\n0,\"two bodies\",") &&
                        Catch::Contains(",calibrated,2,0.") &&
                        Catch::Contains(",calibrated,1,,,\n"));
  const auto e = recon_program("evaluate " + (dir / "m") + " " + (dir / "run"));
  CHECK_THAT(e.text, Catch::Contains("10 records of two people: 10 separated, 0 flagged; of 10 "
                                     "others 0 separated") &&
                         Catch::Contains("iou_person"));
}

TEST_CASE("the interval of a body taken apart grows as the other one comes nearer") {
  Rng rng = make_rng(4, 0);
  std::uniform_real_distribution<double> apart(0.5, 2.5);
  std::exponential_distribution<double> error(1);
  const auto draw = [&](std::size_t count) {
    std::vector<SeparatedError::Sum> out;
    for (std::size_t i = 0; i < count; ++i) {
      const double apart_m = apart(rng);
      out.push_back({apart_m, error(rng) / apart_m});
    }
    return out;
  };
  SeparatedError learnt;
  CHECK(std::isnan(learnt(1)));
  learnt.fit(draw(LateralError::least_records - 1));
  CHECK(std::isnan(learnt(1)));
  learnt.fit(draw(2000));
  // 90 % of an exponential distribution of mean 1 are below ln 10.
  for (const double apart_m : {0.5, 1.0, 2.0})
    CHECK(learnt(apart_m) == Approx(std::log(10) / apart_m).epsilon(0.12));
  const test::Folder folder;
  {
    auto file = record::H5File::create(folder / "a.h5");
    file.write("group", std::vector<double>{1}, {1});
    learnt.save(file, "group");
    file.write("before", std::vector<double>{1}, {1});
  }
  const auto file = record::H5File::open(folder / "a.h5");
  SeparatedError read, of_before;
  read.load(file, "group"), of_before.load(file, "before");
  CHECK(read(0.7) == learnt(0.7));
  CHECK(std::isnan(of_before(0.7)));
}

// SPDX-License-Identifier: MIT
#include "world.hpp"

namespace {

struct Plate {
  double x, z;
};
// Returns an SPD axis three times as long as the SPD axis of the plates. On the shorter axis, two
// plates would fill half of the bins, so that the background could not be estimated.
Axis long_axis() {
  Axis axis = spd_axis();
  axis.count *= 3;
  return axis;
}
record::FusedRecord record_of(std::int64_t index, const Plate& p, Rng& rng) {
  record::FusedRecord out = plate_record(index, p.x, p.z, rng);
  counts(out).resize(long_axis().count);
  return out;
}

constexpr Plate near_left{-0.6, 3.05}, far_right{0.5, 3.85};

// Adds the data of a second object to a record. The objects do not hide each other in the sensor
// data. The depth map shows the nearer object.
void add(record::FusedRecord& to, const record::FusedRecord& other) {
  for (std::size_t i = 0; i < counts(to).size(); ++i) counts(to)[i] += counts(other)[i];
  for (std::size_t i = 0; i < power(to).size(); ++i) power(to)[i] += power(other)[i];
  for (std::size_t p = 0; p < depth_mm(to).size(); ++p)
    if (depth_mm(to)[p] == 0 || (depth_mm(other)[p] > 0 && depth_mm(other)[p] < depth_mm(to)[p]))
      depth_mm(to)[p] = depth_mm(other)[p];
  to.label = two_people_label;
}

// Writes records that alternately show two plates and one plate. Two plates are one behind the
// other if `behind` is true, and side by side otherwise.
void write_mixed(const std::string& path, std::int64_t count, bool behind) {
  Rng rng = make_rng(9, 9);
  std::uniform_real_distribution<double> off(-0.1, 0.1);
  a_run(count, 5,
        [&](FusedRecord& r) {
          if (r.index % 2) return;
          const std::int64_t index = r.index;
          const double far_z = behind ? far_right.z : near_left.z;
          r = record_of(index, {near_left.x + off(rng), near_left.z + off(rng) / 4}, rng);
          add(r, record_of(index, {far_right.x + off(rng), far_z + off(rng) / 4}, rng));
        })
      .spd(long_axis())
      .write(path);
}

const TrainedModel& trained() {
  static const TrainedModel model = [] {
    TrainOptions options = quiet_options("factorised-4");
    options.uncertainty = true, options.split.validation_share = 0.3;
    const Folder dir;
    a_run(600).spd(long_axis()).write(dir / "plates");
    return train(load({dir / "plates"}), options);
  }();
  return model;
}

}  // namespace

TEST_CASE("records of two people are flagged, counted and reported, and keep their maps") {
  const ReconFolder dir;
  save_model(trained(), dir / "m");
  for (const bool behind : {true, false}) {
    CAPTURE(behind);
    std::filesystem::remove(dir / "run");
    write_mixed(dir / "run", 120, behind);
    const Dataset data = load({dir / "run"});
    const Rows rows = all_rows(data.size());
    const Prediction made = predict(trained(), data, rows);
    CHECK(made.maps.values == predict(trained(), data, rows, PredictionDetail::maps).maps.values);
    std::size_t two = 0, others = 0, named = 0;
    for (const std::size_t i : rows) {
      const OutOfDistributionScore& s = made.uncertainties[i].out_of_distribution;
      (i % 2 ? others : two) += !s.reason.empty();
      named +=
          i % 2 == 0 && s.text().starts_with("two bodies, or one unlike the training records'");
    }
    CHECK((two >= 57 && others <= 3));
    if (!behind) CHECK(named > 50);
    dir.says("evaluate m run",
             {std::to_string(two) + " of 60 records with two people are flagged"});
    dir.says("reconstruct m run --force --out o --format npy",
             {"of 120 records are out of distribution: "});
    CHECK_THAT(contents(dir / "o/records.csv"),
               Contains(",\"two bodies, or one unlike the training records'"));
  }
}

TEST_CASE("the two-body test is disabled only if all training records show two people") {
  const std::size_t count = 400;
  Dataset data = load_plates(count);
  const Dataset bare = data;
  for (std::size_t i = 0; i < count; i += 5)
    add_body(data, i, bare), data.records[i].label = two_people_label;
  const Rows rows = all_rows(count);
  Dataset two = with_second_bodies(bare);
  CHECK(share_flagged(outlier_scores(data, rows, two)) > 0.5);
  for (RecordInfo& info : two.records) info.label = two_people_label;
  for (const auto& s : outlier_scores(two, rows, two)) CHECK(std::isnan(s.two_bodies));
}

TEST_CASE("records of two people in front of a wall are flagged") {
  const std::size_t count = 400;
  const Folder dir;
  a_run(count).spd(long_axis()).write(dir / "run");
  const Dataset bare = load({dir / "run"});
  Rng rng = make_rng(6, 6);
  std::poisson_distribution<int> wall(3e4);
  const auto before_wall = [&](Dataset data) {
    for (std::size_t i = 0; i < count; ++i)
      for (std::size_t c = 60; c < 64; ++c)
        photons(data).row(i)[c] += static_cast<float>(wall(rng));
    return data;
  };
  const Dataset training = before_wall(bare), two = before_wall(with_second_bodies(bare));
  const auto flagged = [&](const Dataset& data) {
    return std::ranges::count_if(outlier_scores(training, all_rows(count), data),
                                 [](const auto& s) { return s.two_bodies > 1; });
  };
  CHECK(flagged(training) < 20);
  CHECK(flagged(two) > 200);
}

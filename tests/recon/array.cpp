// SPDX-License-Identifier: MIT
// Tests the use of radar antenna samples: spatial lags, the direction of the body, and models.
#include "recon/data/lags.hpp"
#include "recon/method/array_view.hpp"
#include "recon/method/rotation.hpp"
#include "world.hpp"

namespace {

const record::Antennas line = {{0, 0, 1, 0}, {1, 0, 1.3, 0.4},  {2, 0, 0.8, -1},  {3, 0, 1, 2},
                               {4, 0, 1, 0}, {5, 0, 1.1, -2.5}, {6, 0, 0.9, 0.1}, {7, 0, 1, 1}};

// Returns the covariance of the antenna samples for a single point scatterer in the direction given
// by the sines u and v.
std::vector<float> point(const record::Antennas& antennas, double u, double v, float power) {
  record::ArrayStatistics sums(1, antennas.size());
  std::vector<std::complex<float>> samples;
  for (const auto& a : antennas)
    samples.push_back(std::sqrt(power) *
                      std::polar(static_cast<float>(a.gain),
                                 static_cast<float>(M_PI * (a.x * u + a.y * v) + a.phase_rad)));
  sums.add(samples);
  return sums.take();
}

void write_plates(const std::string& path, std::int64_t count, std::uint64_t seed,
                  const Change& change = {}, double wrong_offset_m = 0) {
  a_run(count, seed, change)
      .offset(Sensor::radar, wrong_offset_m, 0.001)
      .antennas(line)
      .write(path);
}

Axis lags_of_plates() {
  return lags_axis(record::array_axis(radar_axis(), line.size()), SpatialLags(line));
}

// Returns the spatial lags of an object that consists of three scatterers at direction sines near
// u.
std::vector<float> body_lags(double range_m, double u) {
  const Axis axis = lags_of_plates();
  std::vector<float> out;
  for (std::uint32_t b = 0; b < axis.count; ++b)
    for (std::size_t d = 0; d <= static_cast<std::size_t>(axis.scale); ++d) {
      std::complex<double> sum = 0;
      for (const double off : {-0.05, 0.0, 0.04})
        sum += std::exp(-std::pow((axis.at(b) - range_m) / 0.4, 2)) *
               std::polar(1.0, M_PI * static_cast<double>(d) * (u + off));
      out.push_back(static_cast<float>(sum.real()));
      if (d > 0) out.push_back(static_cast<float>(sum.imag()));
    }
  return out;
}

TrainOptions factorised() { return quiet_options("factorised-4", 30); }

double iou_of(const TrainedModel& model, const std::string& path) {
  Dataset data = load({path});
  model.match(data);
  return scores_of(model, data)[metric_iou].mean;
}

}  // namespace

static std::complex<float> lag_of(const std::vector<float>& bin, std::size_t d) {
  return d == 0 ? bin[0] : std::complex<float>(bin[2 * d - 1], bin[2 * d]);
}

TEST_CASE("spatial lags of an antenna array do not depend on antenna gains and phases") {
  const SpatialLags lags(line);
  REQUIRE(lags.longest() == 7);
  std::vector<float> out(lag_values(7));
  const auto array = point(line, 0.37, 0.2, 5);
  lags(record::bin_of(array, line.size(), 0), out);
  for (std::size_t d = 0; d <= 7; ++d) {
    const auto expected = std::polar(5.f, static_cast<float>(M_PI * static_cast<double>(d) * 0.37));
    CHECK(std::abs(lag_of(out, d) - expected) < 1e-4f);
  }
}

TEST_CASE("a planar array has horizontal and vertical lags, and a single antenna has no lags") {
  const SpatialLags planar({{0, 0, 1, 0}, {1, 0, 1, 0}, {0, 1, 1, 0}, {3, 1, 1, 0}});
  REQUIRE(planar.longest() == 4);
  const Axis axis = lags_axis({"array", "covariance", "m", 20, 0, 0.25, 4}, planar);
  CHECK(axis.quantity == "lags 1 3 4, 1 up");
  CHECK(lags_up(axis) == 1);
  CHECK(lags_up(lags_of_plates()) == 0);
  std::vector<float> out(lag_values(4));
  const auto array = point({{0, 0, 1, 0}, {1, 0, 1, 0}, {0, 1, 1, 0}, {3, 1, 1, 0}}, 0.2, 0.7, 1);
  planar(record::bin_of(array, 4, 0), out);
  CHECK(std::arg(lag_of(out, 1)) == Approx(M_PI * 0.2));
  CHECK(std::abs(lag_of(out, 2)) == 0);
  CHECK(std::arg(lag_of(out, 3)) == Approx(M_PI * 0.6));
  CHECK(std::arg(lag_of(out, 4)) == Approx(M_PI * 0.7));
  const SpatialLags one(record::Antennas{{0, 0, 1, 0}});
  CHECK(lags_axis({"array", "covariance", "m", 20, 0, 0.25, 1}, one).count == 0);
}

TEST_CASE("loading converts antenna samples to spatial lags and reports records without samples") {
  const Folder dir;
  write_plates(dir / "run", 4, 1, [](FusedRecord& r) {
    if (r.index == 2) antenna_data(r).clear(), r.array_frames = 0;
  });
  const Dataset data = load({dir / "run"});
  CHECK(antenna_lags(data).axis.quantity == "lags");
  CHECK(antenna_lags(data).cols == antenna_lags(data).axis.count * lag_values(7));
  CHECK(fault_of(data, 0, Inputs::fused).empty());
  CHECK_THAT(fault_of(data, 2, Inputs::fused), Contains("lacks the samples"));
  CHECK(fault_of(data, 2, Inputs::fused_profile).empty());
  CHECK(left_out(data, Inputs::fused) == Words{"", "", "antennas missing", ""});
  Dataset moved = data;
  // The offset of 0.25 m shifts the data by one range bin.
  subtract_range_offset(moved, 0.25);
  for (std::size_t c = 60; c < 90; ++c)
    CHECK(antenna_lags(moved).row(0)[c] ==
          Approx(antenna_lags(data).row(0)[c + lag_values(7)]).margin(1e-5));
  Dataset other = data;
  Layout axes{photons(data).axis, profiles(data).axis, antenna_lags(data).axis};
  axes.array.count = 5;
  match_axes(other, axes, Inputs::fused);
  CHECK(antenna_lags(other).cols == 5 * lag_values(7));
  CHECK(antenna_lags(part_of(other, {1})).values.size() == 5 * lag_values(7));
  match_axes(other, axes, Inputs::fused_profile);
  CHECK(antenna_lags(other).axis.count == 0);
  CHECK_THROWS_WITH(
      match_axes(other, axes, Inputs::fused),
      Contains("contains no radar antenna samples") && Contains("--inputs fused-profile"));
}

TEST_CASE("array features rotated by an angle equal those of a body at that angle") {
  const ArrayView view(lags_of_plates());
  std::vector<float> middle(view.size()), right(view.size());
  view(body_lags(3.6, 0), 3.5, middle);
  view(body_lags(3.6, 0.41), 3.5, right);
  CHECK(middle[0] == Approx(0).margin(0.01));
  CHECK(right[0] - middle[0] == Approx(0.41).margin(1e-3));
  ArrayView::turn(0.41, 3.5, middle);
  for (std::size_t i = 0; i < right.size(); ++i) CHECK(right[i] == Approx(middle[i]).margin(5e-3));
  CHECK(middle[1] == Approx(middle[0] * 3.5));
  view(std::vector<float>(ColumnAxis(lags_of_plates()).size()), 3.5, right);
  CHECK(std::all_of(right.begin(), right.end(), [](float v) { return v == 0; }));
  CHECK(ArrayView(Axis{}).size() == 0);
}

TEST_CASE("a model trained with antenna samples requires such samples and tolerates a range bias") {
  const ReconFolder dir;
  write_plates(dir / "train", 500, 1);
  write_plates(dir / "fresh", 60, 2);
  write_plates(dir / "biased", 60, 2, {}, 0.1);
  a_run(60, 2).write(dir / "profile");
  TrainedModel model = train(load({dir / "train"}), factorised());
  CHECK(model.first().features.axes.array.count > 0);
  CHECK(model.first().alignment.array_features() > 0);
  save_model(model, dir / "model.h5");
  const TrainedModel loaded = load_model(dir / "model.h5");
  const double iou = iou_of(loaded, dir / "fresh");
  CHECK(iou == iou_of(model, dir / "fresh"));
  CHECK(iou > 0.6);
  TrainOptions of_profile = factorised();
  of_profile.inputs = "fused-profile";
  const TrainedModel one_antenna = train(load({dir / "train"}), of_profile);
  CHECK(one_antenna.first().features.axes.array.count == 0);
  CHECK(iou_of(one_antenna, dir / "fresh") > 0.6);
  CHECK(iou_of(one_antenna, dir / "profile") == iou_of(one_antenna, dir / "fresh"));
  CHECK(iou_of(loaded, dir / "biased") > 0.9 * iou);
  CHECK(iou_of(one_antenna, dir / "biased") < 0.5 * iou);
  CHECK_THAT(dir.done("evaluate model.h5 profile", 1),
             Contains("contains no radar antenna samples"));
}

TEST_CASE("records with wrong antenna metadata are flagged as out of distribution") {
  const Folder dir;
  write_plates(dir / "train", 500, 1);
  write_plates(dir / "fresh", 200, 2);
  TrainOptions options = factorised();
  options.uncertainty = true, options.split.validation_share = 0.3, options.fit.epochs = 2;
  const TrainedModel model = train(load({dir / "train"}), options);
  const auto flagged = [&] {
    return share_flagged(predict(model, load({dir / "fresh"}), all_rows(200)).uncertainties);
  };
  CHECK(flagged() < 0.04);
  damage(dir / "fresh", "antennas are shifted by 4 places");
  CHECK(flagged() > 0.6);
  damage(dir / "fresh", "phase errors of the antennas");
  CHECK(flagged() > 0.9);
}

TEST_CASE("a model uses the range profile without antenna data, and the SPD without a radar") {
  const Folder dir;
  write_plates(dir / "train", 200, 1);
  write_plates(dir / "fresh", 8, 2, [](FusedRecord& r) {
    if (r.index >= 2) antenna_data(r).clear(), r.array_frames = 0;
    if (r.index == 4) lose(r, Sensor::radar);
    if (r.index == 5) std::ranges::fill(power(r), 0.5f);  // the radar fails
    if (r.index == 6) lose(r, Sensor::spd);
  });
  a_run(8, 2).write(dir / "old");
  TrainOptions options = factorised();
  options.fit.epochs = 5, options.fallback = true;
  save_model(train(load({dir / "train"}), options), dir / "model.h5");
  TrainedModel model = load_model(dir / "model.h5");
  options.inputs = "fused-profile";
  const TrainedModel of_profile = train(load({dir / "train"}), options);
  const auto matched = [&](const std::string& run) {
    Dataset data = load({dir / run});
    model.match(data);
    return data;
  };
  const Dataset old = matched("old"), fresh = matched("fresh");
  const Rows all = all_rows(8), but_one = {0, 1, 2, 3, 4, 5, 7};
  CHECK(model.predict(old, all).values == of_profile.predict(old, all).values);
  CHECK(model.note_of(old, 3).empty());
  const std::string profile_alone = "antennas lost: range profile alone",
                    spd_alone = "radar lost: SPD alone";
  for (const auto& [row, note] : {std::pair<std::size_t, std::string>{1, ""},
                                  {3, profile_alone},
                                  {4, spd_alone},
                                  {5, spd_alone}})
    CHECK(model.note_of(fresh, row) == note);
  CHECK(model.estimator_for(fresh, 6) == nullptr);
  CHECK(model.fault_of(fresh, 5).empty());
  CHECK_THAT(model.fault_of(fresh, 6), Contains("lacks "));
  const Matrix maps = model.predict(fresh, but_one), own = model.predict(fresh, {1});
  const Matrix profile = of_profile.predict(old, {3}),
               spd = of_profile.estimators[1].maps(old, {4, 5});
  const std::vector<std::pair<std::size_t, std::span<const float>>> by = {
      {1, own.row(0)}, {3, profile.row(0)}, {4, spd.row(0)}, {5, spd.row(1)}};
  for (const auto& [row, alone] : by)
    for (std::size_t p = 0; p < maps.cols; ++p)
      REQUIRE(maps.row(row)[p] == Approx(alone[p]).margin(1e-4));
  // Saving must fail, because each estimator must have fewer inputs than the estimator before it.
  model.estimators[1] = std::move(load_model(dir / "model.h5").first());
  CHECK_THROWS_WITH(save_model(model, dir / "chain.h5"),
                    Contains("1/inputs") && Contains("fewer sensors"));
}

TEST_CASE("a model uses only the range profile if a run has no antennas or different antennas") {
  const ReconFolder dir;
  write_plates(dir / "new", 60, 1), write_plates(dir / "fresh", 8, 2);
  a_run(60, 3).write(dir / "old");
  a_run(8, 3).antennas({line.begin(), line.begin() + 4}).write(dir / "four");
  const std::string train = "train --model factorised --epochs 3 ";
  dir.done(train + "-q new --out a.h5");
  dir.done("evaluate --json a.h5 fresh");
  for (const auto& [run, why] :
       {std::pair<std::string, std::string>{"old", "contains no radar antenna samples"},
        {"four", "antennas differ from those in training"}}) {
    dir.says("evaluate a.h5 " + run, {why, "factorised fused-profile"});
    dir.says("reconstruct -q --force --out maps a.h5 " + run,
             {why + ": only the radar's range profile"});
  }
  dir.says(train + "new old --out b.h5", {"the radar antennas differ between the runs"});
  dir.done(train + "-q --inputs fused-profile new --out c.h5");
  for (const std::string files : {"b.h5 fresh", "b.h5 old", "c.h5 fresh", "c.h5 old"})
    dir.done("reconstruct -q --force --out maps " + files);
}

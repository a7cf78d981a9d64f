// SPDX-License-Identifier: MIT
// How bright the radar sees a body against the SPD, of a model that may rely on its gains.
#include "recon/uncertainty/gains.hpp"

#include "recon/estimator/predict.hpp"
#include "recon/estimator/train.hpp"
#include "recon/estimator/trained_model.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

namespace {

const std::size_t bins = spd_axis().count;

// Radar power times a gain that falls as the radar's distance rises, as in nature.
void add_gain(record::FusedRecord& r, double gain) {
  double sum = 0, moment = 0;
  for (std::uint32_t i = 0; i < r.radar.size(); ++i)
    sum += double{r.radar[i]}, moment += double{r.radar[i]} * radar_axis().at(i);
  for (float& v : r.radar) v *= static_cast<float>(gain * 100 / std::pow(moment / sum, 4));
}

void write_plates(const std::string& path, std::int64_t count, std::uint64_t seed, double gain) {
  write_run(path, count, seed, [=](record::FusedRecord& r) { add_gain(r, gain); });
}

struct Stable {
  Folder dir;
  Matrix raw;
  Alignment alignment;
  Stable() {
    write_plates(dir / "run", 80, 1, 1);
    const Dataset data = load({dir / "run"});
    const Rows rows = all_rows(data.size());
    raw = fit_features(data, rows, Inputs::fused, raw_scaling).raw_inputs(data, rows);
    alignment = Alignment({data.spd_axis, data.radar_axis}, raw, rows, Gains::stable);
  }
  // Of a record whose radar has such a gain.
  std::vector<float> brightness(std::size_t row, float gain) const {
    std::vector<float> record(raw.row(row).begin(), raw.row(row).end());
    for (std::size_t i = bins; i < record.size(); ++i) record[i] *= gain;
    std::vector<float> features(alignment.size());
    alignment(record, features);
    const auto out = alignment.brightness_of(std::span<const float>(features));
    return {out.begin(), out.end()};
  }
};

TrainOptions quick(Gains gains) {
  TrainOptions out;
  out.model = "factorised-4", out.gains = gains;
  out.fit.epochs = 3, out.fit.quiet = true;
  return out;
}

}  // namespace

TEST_CASE("brightness is the logarithm of the radar's gain, and not known without a radar") {
  const Stable s;
  const auto usual = s.brightness(3, 1), twice = s.brightness(3, 2);
  CHECK(usual[1] == 1);
  CHECK(double{twice[0] - usual[0]} == Approx(std::log(2.0)).margin(1e-3));
  CHECK(s.brightness(3, 0) == std::vector<float>{0, 0});
  double mean = 0;
  for (std::size_t i = 0; i < s.raw.rows; ++i) mean += double{s.brightness(i, 1)[0]} / 80;
  CHECK(mean == Approx(0).margin(1e-4));
}

TEST_CASE("without the promise of stable gains nothing of them reaches a model") {
  const Stable s;
  const Dataset data = load({s.dir / "run"});
  const Alignment plain({data.spd_axis, data.radar_axis}, s.raw, all_rows(s.raw.rows));
  CHECK(plain.size() + Brightness::features == s.alignment.size());
  std::vector<float> features(plain.size());
  CHECK(plain.brightness_of(std::span(features)).empty());
}

TEST_CASE("gains are stable, have changed, or cannot be told") {
  const Stable s;
  const auto check = [&](double gain, std::size_t count) {
    Matrix changed = s.raw;
    for (std::size_t row = 0; row < changed.rows; ++row)
      for (float& v : changed.row(row).subspan(bins)) v *= static_cast<float>(gain);
    return check_gains(s.alignment, take_rows(s.alignment(changed), all_rows(count)));
  };
  CHECK(check(1, 80).stable);
  CHECK(check(1, 80).text().empty());
  CHECK(check(1.02, 80).stable);
  const GainCheck more = check(1.2, 80);
  CHECK_FALSE(more.stable);
  CHECK(more.change == Approx(0.2).margin(0.005));
  CHECK_THAT(more.text(),
             Catch::Contains("% more than in training: a gain has changed, or people"));
  CHECK_THAT(check(0.8, 80).text(), Catch::Contains("less than in training"));
  CHECK_FALSE(check(1, 49).stable);
  CHECK_THAT(check(1, 49).text(), Catch::Contains("too few to check the gains"));
}

TEST_CASE("a model of stable gains lives in its file and does without them when they change") {
  const Folder dir;
  write_plates(dir / "run", 150, 1, 1);
  save_model(train(load({dir / "run"}), quick(Gains::stable)), dir / "model");
  const TrainedModel model = load_model(dir / "model");
  REQUIRE(model.alignment.gains() == Gains::stable);
  const auto maps = [&](double gain) {
    const std::string path = dir / ("run" + std::to_string(gain));
    write_plates(path, 100, 2, gain);
    const Records records = prepare_records(model, load_recorded({path}), RangeBiasAction::ignore);
    CHECK(records.gains.stable == (gain == 1));
    return predict(model, records, all_rows(100), PredictionDetail::maps).maps.values;
  };
  const auto as_trained = maps(1), twice = maps(2);
  const bool changed = as_trained != twice, again = twice == maps(4);
  CHECK(changed);
  CHECK(again);  // nothing of the gain is left
}

TEST_CASE("train takes stable gains of models that look at the body, and evaluate checks them") {
  const Folder dir;
  write_plates(dir / "run", 300, 1, 1);
  write_plates(dir / "other", 100, 2, 1.5);
  const auto refused = recon_program("train -q --gains stable --model mlp " + (dir / "run") +
                                     " --out " + (dir / "m"));
  CHECK(refused.code == 2);
  CHECK_THAT(refused.text, Catch::Contains("--gains stable: of silhouette and factorised models"));
  REQUIRE(recon_program("train -q --gains stable --model silhouette --epochs 5 --no-fallback " +
                        (dir / "run") + " --out " + (dir / "m"))
              .code == 0);
  CHECK_THAT(recon_program("evaluate " + (dir / "m") + " " + (dir / "other")).text,
             Catch::Contains("brightness is not used"));
}

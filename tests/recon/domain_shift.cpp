// SPDX-License-Identifier: MIT
#include "recon/trust/domain_shift.hpp"

#include "recon/estimator/predict.hpp"
#include "recon/estimator/train.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

namespace {

Dataset plates(std::int64_t count, std::uint64_t seed, const Change& change = {}) {
  const Folder dir;
  write_run(dir / "run", count, seed, change);
  return load({dir / "run"});
}

TrainedModel trained(const std::string& name, const std::string& inputs) {
  TrainOptions options;
  options.model = name, options.inputs = inputs, options.fit.quiet = true;
  return train(plates(400, 1), options);
}

DomainShift shift_of(const TrainedModel& model, const Dataset& data) {
  return domain_shift_of(model, prepare_records(model, data));
}

// An echo behind each bin's own, a third as strong.
void blur(std::vector<float>& profile) {
  for (std::size_t i = profile.size() - 1; i > 0; --i) profile[i] += profile[i - 1] / 3;
}

const Change blurred = [](record::FusedRecord& r) { blur(r.radar); };

}  // namespace

TEST_CASE("a run of another world is told from those of the own world") {
  for (const auto& [name, inputs] : {std::pair{"silhouette", "fused"}, {"ridge", "radar"}}) {
    CAPTURE(inputs);
    const TrainedModel model = trained(name, inputs);
    double most_own = 0, least_other = 1e9;
    int alarms = 0;
    for (std::uint64_t seed = 10; seed < 20; ++seed) {
      const DomainShift own = shift_of(model, plates(100, seed));
      const DomainShift other = shift_of(model, plates(100, seed + 100, blurred));
      most_own = std::max(most_own, own.distance), alarms += own.found();
      least_other = std::min(least_other, other.distance);
      CHECK(other.found());
      CHECK_THAT(other.text(), Catch::StartsWith("this run is unlike the training: ") &&
                                   Catch::Contains("radar"));
    }
    CHECK(most_own < least_other);
    CHECK(alarms == 0);
  }
}

TEST_CASE(
    "gains are no other world, and few records and many of one pose are not tested too hard") {
  const TrainedModel model = trained("silhouette", "fused");
  CHECK_FALSE(shift_of(model, plates(100, 10,
                                     [](record::FusedRecord& r) {
                                       for (float& v : r.radar) v *= 5;
                                       for (auto& v : r.spd) v *= 3;
                                     }))
                  .found());
  CHECK_FALSE(shift_of(model, plates(15, 11)).tested());
  CHECK(shift_of(model, plates(15, 11)).text().empty());
}

TEST_CASE("radar power before the body is what is nearer than half of its range") {
  const TrainedModel model = trained("ridge", "radar");
  // The plates stand in the bins from 12 on.
  const auto said = [&](std::size_t from, std::size_t to) {
    const DomainShift shift = shift_of(model, plates(100, 10, [=](record::FusedRecord& r) {
                                         for (std::size_t i = from; i < to; ++i) r.radar[i] += 0.3f;
                                       }));
    CHECK(shift.found());
    return shift.text();
  };
  const std::string name = "radar power before the body";
  CHECK_THAT(said(0, 6), Catch::Contains(name));
  CHECK_THAT(said(9, 11), !Catch::Contains(name));
}

TEST_CASE("what the training was like stays in its file") {
  const Folder dir;
  const TrainedModel model = trained("silhouette", "fused");
  save_model(model, dir / "m");
  const Dataset data = plates(60, 12, blurred);
  const DomainShift a = shift_of(model, data), b = shift_of(load_model(dir / "m"), data);
  CHECK(a.distance == b.distance);
  CHECK(a.text() == b.text());
  write_run(dir / "other", 60, 12, blurred);
  for (const std::string& command :
       {"evaluate " + (dir / "m") + " " + (dir / "other"),
        "reconstruct " + (dir / "m") + " " + (dir / "other") + " --out " + (dir / "o")})
    CHECK_THAT(recon_program(command).text, Catch::Contains(a.text()));
}

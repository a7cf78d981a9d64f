// SPDX-License-Identifier: MIT
#include "recon/trust/speckle.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "drivers/core/random.hpp"
#include "recon/trust/uncertainty.hpp"

using namespace echofuse;
using namespace echofuse::recon;

namespace {

// Records whose power varies log-normally about these.
Dataset records_of(std::size_t count, double over_frames, std::optional<double> over_carriers,
                   std::uint64_t seed, std::optional<double> over_150_ms = {}) {
  Dataset data;
  Rng rng = make_rng(seed, 0);
  std::normal_distribution<double> unit(0, 0.3);
  for (std::size_t i = 0; i < count; ++i) {
    record::Speckle s{over_frames * std::exp(unit(rng)), {}};
    if (over_carriers) s.over_carriers = *over_carriers * std::exp(unit(rng));
    if (over_150_ms) s.over_150_ms = *over_150_ms * std::exp(unit(rng));
    data.speckle.emplace_back(s);
    data.valid.push_back(7);
  }
  return data;
}

SpeckleReference learnt(const Dataset& data) {
  return {data, Matrix(data.size(), 0), all_rows(data.size())};
}

double flagged(const SpeckleReference& reference, const Dataset& data) {
  double count = 0;
  for (const auto& s : data.speckle) count += reference.share(s.value()) > 1;
  return count / static_cast<double>(data.size());
}

std::string said(const SpeckleReference& reference, const Dataset& data) {
  return reference.of_run(data, Matrix(data.size(), 0));
}

}  // namespace

TEST_CASE("power that varies otherwise than in training is unusual, more and less") {
  const auto reference = learnt(records_of(2000, 0.02, {}, 1));
  CHECK(flagged(reference, records_of(1000, 0.02, {}, 2)) < 0.01);
  CHECK(flagged(reference, records_of(1000, 0.5, {}, 3)) > 0.98);
  CHECK(said(reference, records_of(50, 0.02, {}, 2)).empty());
  CHECK_THAT(said(reference, records_of(50, 0.5, {}, 3)),
             Catch::Contains("varies otherwise than in training: 0.5") &&
                 Catch::Contains("0.02 in training (echoes that interfere"));
  // A run shows less than a record does.
  CHECK(flagged(reference, records_of(1000, 0.08, {}, 6)) < 0.3);
  CHECK_FALSE(said(reference, records_of(50, 0.08, {}, 6)).empty());
  // Plain noise, less and a little more, is none.
  for (const double noise : {0.0003, 0.002, 0.03}) {
    CAPTURE(noise);
    CHECK(flagged(reference, records_of(1000, noise, {}, 7)) == 0);
    CHECK(said(reference, records_of(50, noise, {}, 7)).empty());
  }
  const auto moving = learnt(records_of(2000, 0.5, {}, 4));
  CHECK(flagged(moving, records_of(1000, 0.02, {}, 5)) > 0.98);
  CHECK_THAT(said(moving, records_of(50, 0.02, {}, 5)),
             Catch::Contains("(people who move less, more carriers"));
}

TEST_CASE("carriers count by themselves, and a run without them says so") {
  const auto reference = learnt(records_of(2000, 0.1, 0.8, 1));
  CHECK(flagged(reference, records_of(1000, 0.1, 0.8, 2)) < 0.01);
  CHECK(flagged(reference, records_of(1000, 0.1, 0.05, 3)) > 0.98);
  CHECK_THAT(said(reference, records_of(50, 0.1, 0.05, 3)),
             Catch::Contains("from carrier to carrier"));
  CHECK_THAT(said(reference, records_of(50, 0.1, {}, 3)),
             Catch::Contains("one carrier, several in training (fewer independent looks)"));
  CHECK(flagged(reference, records_of(100, 0.1, {}, 3)) == 1);
  CHECK(flagged(learnt(records_of(2000, 0.1, {}, 1)), records_of(1000, 0.1, 0.8, 2)) < 0.01);
}

TEST_CASE("who moves less than in training is unusual, who moves more is not") {
  const auto reference = learnt(records_of(2000, 0.5, {}, 1, 0.3));
  CHECK(flagged(reference, records_of(1000, 0.5, {}, 2, 0.3)) < 0.01);
  CHECK(flagged(reference, records_of(1000, 0.5, {}, 3, 0.03)) > 0.98);
  CHECK(flagged(reference, records_of(1000, 0.5, {}, 4, 0.5)) < 0.01);
  CHECK_THAT(said(reference, records_of(50, 0.5, {}, 3, 0.03)),
             Catch::Contains("within 150 ms, 0.3 in training (people who move less"));
  CHECK(said(reference, records_of(50, 0.5, {}, 4, 0.5)).empty());
  CHECK(reference.less_motion({0.5, {}, 0.01}));
  CHECK_FALSE(reference.less_motion({0.5, {}, 0.3}));
  // Of older runs it is not known.
  CHECK(flagged(reference, records_of(1000, 0.5, {}, 2)) < 0.01);
  CHECK(flagged(learnt(records_of(2000, 0.5, {}, 1)), records_of(1000, 0.5, {}, 2, 0.01)) < 0.01);
  // A few records do not speak for a run.
  Dataset some = records_of(50, 0.5, {}, 2);
  some.speckle[0]->over_150_ms = 0.01;
  CHECK(said(reference, some).empty());
  // Of noise all of the variation comes within 150 ms, and less of it is no less motion.
  const auto noise = learnt(records_of(2000, 0.3, {}, 1, 0.3));
  CHECK(flagged(noise, records_of(1000, 0.3, {}, 2, 0.03)) < 0.01);
}

TEST_CASE("of runs from before nothing is said") {
  Dataset old = records_of(100, 0.1, {}, 1);
  for (auto& s : old.speckle) s.reset();
  const auto nothing = learnt(old);
  CHECK_FALSE(nothing.known());
  CHECK(nothing.share({0.5, {}}) == 0);
  CHECK(said(nothing, records_of(50, 0.5, {}, 1)).empty());
  CHECK(said(learnt(records_of(2000, 0.5, {}, 1)), old).empty());
}

TEST_CASE("a flagged record has no interval, and its reason says by how much") {
  UncertaintyModel model;
  model.speckle = learnt(records_of(2000, 0.02, {}, 1));
  PredictionUncertainty stated{0.1, {}};
  model.judge_speckle({}, record::Speckle{0.02, {}}, stated);
  CHECK(stated.lateral_interval_90_m == 0.1);
  CHECK(stated.out_of_distribution.reason.empty());
  model.judge_speckle({}, {}, stated);
  CHECK(stated.out_of_distribution.reason.empty());
  model.judge_speckle({}, record::Speckle{0.7, {}}, stated);
  CHECK(std::isnan(stated.lateral_interval_90_m));
  CHECK(stated.out_of_distribution.distance > 1);
  CHECK_THAT(stated.out_of_distribution.text(),
             Catch::StartsWith("unusual variation of the radar's power (0.7 from frame to frame"));
  // Nobody is there: that is another matter.
  PredictionUncertainty empty{0.1, {0, 0, "empty", {}}};
  const std::vector<float> nobody(5, 0.f);
  model.judge_speckle(nobody, record::Speckle{0.7, {}}, empty);
  CHECK(empty.out_of_distribution.reason == "empty");
}

TEST_CASE("what is known of the variation goes into the model's file") {
  auto reference = learnt(records_of(500, 0.1, 0.8, 1, 0.3));
  TensorFile file;
  reference.archive({file, Archive::Direction::write});
  TensorFile again("a model", file.to_bytes());
  SpeckleReference read;
  CHECK_FALSE(read.known());
  read.archive({again, Archive::Direction::read});
  CHECK(read.known());
  CHECK(read.share({0.3, 0.2, 0.1}) == reference.share({0.3, 0.2, 0.1}));
  CHECK(read.less_motion({0.1, 0.8, 0.0}) == reference.less_motion({0.1, 0.8, 0.0}));
  TensorFile none;
  CHECK_THROWS_AS(read.archive({none, Archive::Direction::read}), Error);
}

// SPDX-License-Identifier: MIT
// Tests a model that was trained in one room with a wall and is adapted to a second room.
#include "recon/predict/empty_room.hpp"

#include "recon/data/shift.hpp"
#include "world.hpp"

namespace {

const Axis longer{"spd", "counts", "ps", 60, 16000, 400, 1};

// Position of a wall in the histogram, the range profile and the depth map.
struct Wall {
  std::size_t spd_bin, radar_bin;
  std::uint16_t mm;
};
constexpr Wall here{42, 20, 5000}, elsewhere{50, 22, 5600};

void write_room(const std::string& path, const Wall& wall, std::int64_t count, std::uint64_t seed,
                bool people = true, double longer_m = 0) {
  Rng rng = make_rng(seed, 9);
  a_run(count, seed,
        [=](FusedRecord& r) mutable {
          if (!people) {
            std::ranges::fill(counts(r), 0u);
            std::ranges::fill(power(r), 0.f);
            std::ranges::fill(depth_mm(r), std::uint16_t{0});
          }
          std::poisson_distribution<std::uint32_t> light(30'000);
          std::normal_distribution<float> echo(2, 0.002f);
          for (std::size_t i = 0; i < 3; ++i) counts(r)[wall.spd_bin + i] += light(rng);
          power(r)[wall.radar_bin] += echo(rng);
          std::ranges::replace(depth_mm(r), 0, wall.mm);
          if (longer_m != 0) power(r) = Shift(-longer_m / radar_axis().step).apply(power(r));
        })
      .spd(longer)
      .write(path);
}

double iou_of(const TrainedModel& model, const std::string& path) {
  const Records records = prepare_records(model, load_recorded({path}));
  return evaluate(model, records, all_rows(records.data.size())).metrics[metric_iou].mean;
}

TrainedModel trained(const std::string& path, const std::string& empty, const std::string& name) {
  TrainOptions options = quiet_options(name, 60);
  const Dataset data = load({path});
  if (!empty.empty()) options.background = load_empty_room(data, empty).records;
  return train(data, options);
}

}  // namespace

TEST_CASE("a model trained with an empty-room run keeps its accuracy if adapted to another room") {
  const ReconFolder dir;
  write_room(dir / "here", here, 200, 1), write_room(dir / "here empty", here, 20, 2, false);
  write_room(dir / "there", elsewhere, 60, 3), write_room(dir / "again", here, 60, 3);
  write_room(dir / "there empty", elsewhere, 20, 4, false);
  TrainedModel model = trained(dir / "here", dir / "here empty", "mean-shape");
  const double at_home = iou_of(model, dir / "again"), lost = iou_of(model, dir / "there");
  CHECK(at_home > 0.5);
  CHECK(lost < 0.5 * at_home);
  save_model(model, dir / "model");
  CHECK(adapt_to_room(model, dir / "there empty").empty());
  CHECK(iou_of(model, dir / "there") > 0.95 * at_home);
  CHECK_THROWS_WITH(
      adapt_to_room(model, dir / "there"),
      EndsWith("there: the histograms vary by more than photon noise, so there may be "
               "people in the room; expected a run of the empty room"));
  CHECK(dir.json("evaluate model there --empty 'there empty'")["metrics"]["iou"]["mean"] >
        0.9 * at_home);
}

TEST_CASE("the option --range-offset also applies to the empty-room run") {
  const Folder dir;
  const double longer_m = radar_axis().step;
  write_room(dir / "here", here, 200, 1), write_room(dir / "here empty", here, 20, 2, false);
  write_room(dir / "there", elsewhere, 60, 3, true, longer_m);
  write_room(dir / "there empty", elsewhere, 20, 4, false, longer_m);
  save_model(trained(dir / "here", dir / "here empty", "mean-shape"), dir / "model");
  const auto iou_with = [&](double of_empty_m) {
    TrainedModel model = load_model(dir / "model");
    adapt_to_room(model, dir / "there empty", of_empty_m);
    const Records records = prepare_records(model, load_recorded({dir / "there"}), longer_m);
    return evaluate(model, records, all_rows(60)).metrics[metric_iou].mean;
  };
  CHECK(iou_with(longer_m) > 0.5);
  CHECK(iou_with(0) < 0.6 * iou_with(longer_m));
}

TEST_CASE("a dead radar is detected after a room change") {
  const Folder dir;
  write_room(dir / "here", here, 60, 1);
  Dataset data = load({dir / "here"});
  std::ranges::fill(profiles(data).row(3), 0.f);
  const std::vector<float> before(profiles(data).row(4).begin(), profiles(data).row(4).end());
  Dataset change;
  profiles(change) = repeated_row(std::vector<float>(profiles(data).cols, 0.5f), 1);
  profiles(change).row(0)[20] = 2;
  exchange_room(change.columns, data);
  CHECK(fault_of(data, 3, Inputs::fused) == "radar is the same in every bin");
  CHECK(profiles(data).row(4)[0] == before[0] + 0.5f);
  CHECK(profiles(data).row(4)[20] == before[20] + 2);
}

TEST_CASE("dead and doubtful records of an empty-room run are excluded and counted") {
  const Folder dir;
  write_room(dir / "here", here, 20, 1), write_room(dir / "empty", here, 20, 2, false);
  const Dataset training = load({dir / "here"});
  const auto loaded = [&](std::int64_t first, std::int64_t last, bool dead) {
    damaged(dir / "empty", dir / "bad", "weak SPD in the records from ?1 to ?2", {first, last});
    if (dead)
      damage(dir / "bad", "histograms without counts in the records from ?1 to ?2", {first, last});
    return load_empty_room(training, dir / "bad");
  };
  Rows rows = all_rows(20);
  std::erase_if(rows, [](std::size_t row) { return row >= 3 && row < 15; });
  const std::vector<float> kept = photons(part_of(load({dir / "empty"}), rows)).values;
  for (const bool dead : {true, false}) {
    const EmptyRoom room = loaded(3, 14, dead);
    CHECK(room.left_out == (dir / "bad") + ": 12 of 20 records left out: SPD weak 12");
    CHECK(photons(room.records).values == kept);
  }
  CHECK_NOTHROW(loaded(0, 14, false));
  CHECK_THROWS_WITH(loaded(0, 15, false), Contains("16 of 20 records left out: SPD weak 16"));
}

TEST_CASE("an empty-room run is accepted if its brightness drifts by 3 % and refused at 10 %") {
  const Folder dir;
  write_room(dir / "empty", here, 20, 2, false);
  Dataset empty = load({dir / "empty"});
  const auto scaled = [&](float drift) {
    for (std::size_t row = 0; row < empty.size(); ++row)
      for (std::size_t bin = 0; bin < photons(empty).cols; ++bin)
        photons(empty).row(row)[bin] = 1e5f * (1 + ((row + bin) % 2 ? drift : -drift));
    return error_of([&] { empty_room_of(empty, "empty"); });
  };
  CHECK(scaled(0.03f) == "no error");
  CHECK_THAT(scaled(0.1f), Contains("vary by more than photon noise"));
}

TEST_CASE("a model that uses no background cannot be adapted to another room") {
  const ReconFolder dir;
  write_room(dir / "here", here, 60, 1), write_room(dir / "empty", here, 20, 2, false);
  TrainedModel other = trained(dir / "here", "", "mean-shape");
  CHECK(adapt_to_room(other, dir / "empty") ==
        "the model was trained without --empty, so the walls of the training room may affect the "
        "maps");
  dir.refuses("train -q --model mlp --empty empty --out mlp.h5 here", 2,
              "--empty: mlp does not use a background");
  TrainedModel model = trained(dir / "here", "", "mlp-16");
  CHECK_THROWS_WITH(
      adapt_to_room(model, dir / "empty"),
      "mlp models cannot be used in another room; expected a factorised or mean-shape model");
}

TEST_CASE("an empty-room run with other axes or with fewer than five records is refused") {
  const Folder dir;
  write_room(dir / "here", here, 20, 1), write_room(dir / "four", here, 4, 2, false);
  a_run(5).write(dir / "other");
  const Dataset data = load({dir / "here"});
  CHECK_THROWS_WITH(load_empty_room(data, dir / "four"),
                    (dir / "four") + ": 4 records have data of all sensors; expected at least 5");
  CHECK_THROWS_WITH(load_empty_room(data, dir / "other"),
                    StartsWith((dir / "other") + ": spd axis is 30 x ") &&
                        Contains("that of the training runs is 60 x "));
}

// SPDX-License-Identifier: MIT

#include "recon/data/features.hpp"
#include "recon/data/split.hpp"
#include "world.hpp"

TEST_CASE("two runs are loaded together, but a copy or a run with other axes is refused") {
  const Folder dir;
  a_run(3).write(dir / "a"), a_run(2, 2).write(dir / "b");
  a_run(2).radar({"radar", "power", "m", 24, 0, 0.5, 1}).write(dir / "c");
  const Dataset data = load({dir / "a", dir / "b"});
  CHECK(data.sources.at(1).first == 3);
  CHECK(data.records[0].label == "person");
  CHECK(load({dir / "a"}).hash == load({dir / "a"}).hash);
  CHECK(load({dir / "a"}).hash != load({dir / "b"}).hash);
  std::filesystem::copy_file(dir / "a", dir / "copy");
  CHECK_THROWS_WITH(load({dir / "a", dir / "copy"}),
                    Contains("copy: is the same run as") && Contains("remove the copy"));
  CHECK_THROWS_WITH(load({dir / "a", dir / "c"}),
                    Contains(dir / "c") && Contains("radar axis") && Contains(dir / "a"));
}

TEST_CASE("clicks per laser pulse are read from a record or derived from its counts") {
  // Clicks, starts, and clicks per pulse as recorded and as expected. Older runs do not store the
  // number of clicks per pulse. If such a run contains equal numbers of clicks and starts, the
  // laser rate is unknown.
  const std::vector<std::tuple<std::uint64_t, std::uint64_t, std::optional<double>, double>> rows{
      {1020, 1000, 0.02, 0.02},
      {1020, 1000, {}, 0},
      {999, 1000, {}, 0},
      {400, 1000, {}, 0.4},
      {1000, 0, {}, 0}};
  const Dataset data = load_plates(std::ssize(rows), 1, [&](FusedRecord& r) {
    const auto& [in_range, starts, recorded, expected] = rows[static_cast<std::size_t>(r.index)];
    r.spd_counts = {.starts = starts, .in_range = in_range};
    r.signal.clicks_per_pulse = recorded;
  });
  for (std::size_t i = 0; i < rows.size(); ++i)
    CHECK(data.records[i].clicks_per_pulse == std::get<3>(rows[i]));
}

TEST_CASE("a run is interpolated to the axes of another run if they differ by less than a bin") {
  const Folder dir;
  Axis near = radar_axis();
  near.start += 0.1;
  a_run(2).write(dir / "a"), a_run(2).radar(near).write(dir / "b");
  const Dataset data = load({dir / "a", dir / "b"});
  CHECK(same_axis(profiles(data).axis, radar_axis()));
  const auto first = profiles(data).row(0);
  CHECK(profiles(data).row(2)[10] == Approx(0.4 * first[9] + 0.6 * first[10]));
}

TEST_CASE("depths beyond the map range count as no return, and a wrong depth unit is refused") {
  const ReconFolder dir;
  const auto scaled = [](double by, std::int64_t every) {
    return [by, every](FusedRecord& r) {
      for (auto& mm : depth_mm(r))
        if (r.index % every == 0) mm = static_cast<std::uint16_t>(std::lround(mm * by));
    };
  };
  const auto train_on = [&](const std::string& name, const Change& change) {
    a_run(40, 1, change).write(dir / name);
    return "train --model ridge --out " + name + "-m " + name;
  };
  CHECK_THAT(dir.done(train_on("good", {})), !Contains("median"));
  dir.says(train_on("far", scaled(3, 2)),
           {"far: 20 of 40 records have depths beyond 6 m, treated as no return (", "map_z_max_m"});
  const Dataset farther =
      load({a_run(40, 1, scaled(3, 2)).map({64, 0.55, 14}).write(dir / "farther")});
  CHECK(farther.map.far_m == 14);
  CHECK(std::ranges::max(depth_maps(farther).row(0)) > 6);
  dir.says(train_on("mm", scaled(1e-3, 1)),
           {"mm: the median depth is 3 mm; expected metres in arrays,"}, 1);
  dir.says(train_on("cm", scaled(0.1, 1)),
           {"cm: the median depth is 0.3",
            " m, but the histogram covers 2.4 to 4.2 m; expected depths in metres\n"});
}

TEST_CASE("the median is subtracted from range profiles that include the receiver noise") {
  const Folder dir;
  a_run(2, 1,
        [](FusedRecord& r) {
          power(r).assign(24, 1);
          power(r)[7] = r.index ? 2e38f : 16;
        })
      .radar({"radar", "power_with_noise", "m", 24, 0, 0.25, 1})
      .write(dir / "a");
  CHECK_THROWS_WITH(load({dir / "a"}), Contains("record 1"));
  const Dataset data = load_part(record::RunReader(dir / "a"), 0, 2, sensors_of(Inputs::radar),
                                 [](std::int64_t, const std::string&) {});
  CHECK(profiles(data).axis.quantity == "power");
  CHECK(profiles(data).row(0)[7] == Approx(15));
  CHECK(profiles(data).row(0)[8] == 0);
}

TEST_CASE("a radar axis longer than the model axis is cropped, and other differences are refused") {
  const Folder dir;
  a_run(2).radar(radar_axis(40)).write(dir / "long");
  Dataset data = load({dir / "long"});
  const Dataset before = data;
  match_axes(data, {photons(data).axis, radar_axis(24)}, Inputs::fused);
  CHECK(profiles(data).cols == 24);
  CHECK(profiles(data).row(1)[23] == profiles(before).row(1)[23]);
  const auto refused = [&](const Axis& spd, const Axis& radar, Inputs inputs) {
    Dataset copy = before;
    return error_of([&] { match_axes(copy, {spd, radar}, inputs); });
  };
  const Axis spd = photons(before).axis;
  const std::vector<std::pair<Axis, const char*>> differences{
      {radar_axis(50), "radar axis is 40"},
      {radar_axis(50), ": too short: 40 bins, expected 50"},
      {{"radar", "power", "m", 24, 0.3, 0.25, 1}, ": start differs by 1.2 bins (limit 1)"},
      {{"radar", "power", "m", 24, 0.25, 0.25, 1}, "no error"},
      {{"radar", "power", "m", 24, 0, 0.2, 1},
       ": step differs: 6 bins at the end of the axis (limit 1)"},
      {{"radar", "power", "cm", 24, 0, 0.25, 1}, ": quantity or unit differs"},
      {{"radar", "power", "m", 24, 0, 0.25, 2}, ": scale is 1, expected 2"}};
  for (const auto& [radar, text] : differences)
    CHECK_THAT(refused(spd, radar, Inputs::fused), Contains(text));
  CHECK_THAT(refused({"spd", "counts", "ps", 30, 16000, 500, 1}, radar_axis(40), Inputs::spd),
             Contains("spd axis"));
  // For a model that uses only the SPD, the radar axis is not checked.
  CHECK(refused(spd, radar_axis(50), Inputs::spd) == "no error");
}

TEST_CASE("records are interpolated to the model axis if the two axes differ by less than a bin") {
  Dataset data;
  // The detector has two zones. The second zone has twice the counts of the first zone.
  photons(data).axis = Axis{"spd", "counts", "ps", 5, 100, 10, 1, Zones(2)};
  profiles(data).axis = Axis{"radar", "power", "m", 4, 0, 0.5, 1};
  photons(data) = Matrix(0, 10), profiles(data) = Matrix(0, 4);
  photons(data).add_row(std::vector<float>{0, 10, 20, 40, 0, 0, 20, 40, 80, 0});
  profiles(data).add_row(std::vector<float>{1, 2, 4, 8});
  data.records = {{.valid = SensorSet::from_bits(7)}};
  const Axis spd{"spd", "counts", "ps", 5, 104, 10, 1, Zones(2)},
      radar{"radar", "power", "m", 4, -0.25, 0.5, 1};
  match_axes(data, {spd, radar}, Inputs::fused_profile);
  CHECK(photons(data).values == std::vector<float>{4, 14, 28, 24, 0, 8, 28, 56, 48, 0});
  CHECK(profiles(data).values == std::vector<float>{1, 1.5, 3, 6});
  CHECK(same_axis(photons(data).axis, spd));
  CHECK(same_axis(profiles(data).axis, radar));
}

TEST_CASE("summing radar power into wider bins preserves the total power") {
  const Axis paper = radar_bins(0.5);
  CHECK(std::tuple(paper.count, paper.at(-0.5), paper.at(13.5)) == std::tuple(14, 0, 7));
  const auto rebinned = [&](double step, const std::vector<float>& power) {
    Dataset data;
    const auto bins = static_cast<std::uint32_t>(power.size());
    profiles(data).axis = Axis{"radar", "power", "m", bins, 0, step, 1};
    profiles(data).cols = bins, profiles(data).add_row(power);
    data.records = {{.valid = {Sensor::radar}}};
    rebin_radar(data, paper);
    REQUIRE(same_axis(profiles(data).axis, paper));
    return profiles(data).values;
  };
  // The power is exact if the bin widths have an integer ratio. A narrow bin at the border of two
  // wider bins adds half of its power to each. The model's range ends in the middle of the bin at
  // 7 m (point 112).
  std::vector<float> power(256);
  for (std::size_t i = 0; i < power.size(); ++i) power[i] = static_cast<float>(8 + i * i % 64);
  const auto sum = [](const std::vector<float>& of, std::size_t first, std::size_t last) {
    return std::accumulate(of.begin() + std::ptrdiff_t(first), of.begin() + std::ptrdiff_t(last),
                           0.0);
  };
  const std::vector<float> exact = rebinned(0.0625, power);
  CHECK(sum(exact, 0, 14) == sum(power, 0, 112) + power[112] / 2.0);
  CHECK(double{exact[0]} == sum(power, 0, 8) + power[8] / 2.0);
  CHECK(double{exact[3]} == power[24] / 2.0 + sum(power, 25, 32) + power[32] / 2.0);
  // The power is exact to float precision for the bin widths of real chirps.
  for (const double step : {0.0440950, 0.2502210, 0.25, 0.5})
    for (std::uint32_t at = 0; (at + 0.5) * step <= 7; ++at) {
      std::vector<float> one(256);
      one[at] = 3e7f;
      const std::vector<float> wide = rebinned(step, one);
      double place = 0;
      for (std::uint32_t j = 0; j < 14; ++j) place += double{wide[j]} * paper.at(j) / 3e7;
      REQUIRE(sum(wide, 0, 14) == Approx(3e7).epsilon(1e-7));
      REQUIRE(std::abs(place - at * step) <= 0.25 + 1e-6);
    }
  // A dead radar remains recognisable.
  CHECK(rebinned(0.0625, std::vector<float>(256, 0.25f)) == std::vector<float>(14, 0.25f));
  // The profile must not be coarser or shorter than the wider bins.
  for (const double step : {0.6, 0.25})
    CHECK_THROWS_WITH(rebinned(step, std::vector<float>(24)), Contains("cannot be summed"));
}

TEST_CASE("a model trained on binned radar power accepts runs with unbinned power") {
  const ReconFolder dir;
  a_run(60).radar(radar_axis(40)).write(dir / "run");
  // The range axis of this run ends at 5.9 m, in front of the model's last bin.
  a_run(4).write(dir / "near");
  dir.done("train -q --model ridge --set fallback=false --set radar_bin_m=0.5 run --out m");
  CHECK(load_model(dir / "m").first().features.axes.radar.count == 14);
  dir.done("evaluate m run");
  dir.done("reconstruct -q m run --out maps");
  dir.done("evaluate m near", 1);
}

TEST_CASE("inputs scaled per record do not depend on sensor gains or a flat background") {
  const Dataset data = load_plates(40);
  const Rows rows = usable(data, Inputs::fused);
  Dataset changed = data;
  for (float& v : photons(changed).values) v = 4 * v + 50;
  for (float& v : profiles(changed).values) v *= 0.25f;
  const Features f = fit_features(data, rows, Inputs::fused, "record"),
                 plain = fit_features(data, rows, Inputs::fused, "plain");
  const Matrix a = f.apply(data, rows), b = f.apply(changed, rows);
  for (std::size_t i = 0; i < a.values.size(); ++i)
    REQUIRE(b.values[i] == Approx(a.values[i]).margin(1e-3));
  CHECK(plain.apply(changed, rows).values[10] != Approx(plain.apply(data, rows).values[10]));
}

TEST_CASE("scaled inputs have zero mean and the same total variance for each sensor") {
  const Dataset data = load_plates(60);
  const Rows rows = usable(data, Inputs::fused);
  for (const auto& scaling : scaling_names) {
    CAPTURE(scaling);
    const Matrix x = fit_features(data, rows, Inputs::fused, scaling).apply(data, rows);
    REQUIRE(x.cols == 54);
    double variance[2] = {0, 0}, mean = 0, size = 0;
    for (std::size_t i = 0; i < x.values.size(); ++i) {
      const double v = double{x.values[i]};
      variance[i % 54 >= 30] += v * v / 60, mean += v, size += std::abs(v);
    }
    for (const double of_sensor : variance) CHECK(of_sensor == Approx(27).epsilon(1e-4));
    // The mean of each column is rounded to a float. This rounding error is the same in all 60
    // rows.
    CHECK(std::abs(mean) < 60 * size * std::numeric_limits<float>::epsilon());
  }
}

TEST_CASE("splits into training, validation and test records have the requested sizes and order") {
  const Rows rows = all_rows(4000);
  const Split s = make_split(rows, {});
  CHECK(std::tuple(s.test.size(), s.validation.size(), s.train.size()) ==
        std::tuple(400, 180, 3420));
  // The rows are sorted by the result of two steps of SplitMix64, initialised with the seed and the
  // row number. Other programs can reproduce this order.
  CHECK(drawn({0, 1, 2, 3, 4, 5, 6, 7}, 1, 0x73706c6974) == Rows{3, 1, 6, 7, 5, 2, 4, 0});
  CHECK(make_split(rows, {.seed = 2}).test != s.test);
}

TEST_CASE("random splits are disjoint and complete, and appended rows do not change their order") {
  Rng rng = make_rng(3, 1);
  std::uniform_real_distribution<double> share(0, 0.45);
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    CAPTURE(seed);
    Rows rows;
    for (std::size_t row = 0; rows.size() < 20 + seed * 7; row += 1 + rng() % 3)
      rows.push_back(row);
    SplitOptions options;
    options.test_share = share(rng), options.validation_share = share(rng), options.seed = seed;
    options.kind = seed % 2 ? "blocked" : "random", options.gap = rng() % 4;
    const Split s = make_split(rows, options);
    Rows all;
    for (const Rows* part : {&s.train, &s.validation, &s.test}) {
      CHECK(std::ranges::is_sorted(*part));
      all.insert(all.end(), part->begin(), part->end());
    }
    std::ranges::sort(all);
    CHECK(std::ranges::adjacent_find(all) == all.end());
    CHECK(std::ranges::includes(rows, all));
    if (options.kind == "random") CHECK(all == rows);
    Rows longer = rows;
    for (std::size_t more = 1; more < 30; ++more) longer.push_back(rows.back() + more);
    Rows order = drawn(longer, seed, 5);
    std::erase_if(order, [&](std::size_t row) { return row > rows.back(); });
    CHECK(order == drawn(rows, seed, 5));
  }
}

TEST_CASE("loading part of a run reads only the requested sensors") {
  const Folder dir;
  a_run(3).write(dir / "run");
  const Dataset data = load_part(record::RunReader(dir / "run"), 1, 5, sensors_of(Inputs::spd), {});
  REQUIRE(data.size() == 2);
  CHECK(data.records[0].valid == SensorSet{Sensor::spd});
  CHECK((profiles(data).axis.count == 0 && profiles(data).values.empty()));
  CHECK(depth_maps(data).values.empty());
  CHECK(photons(data).values.size() == 2 * spd_axis().count);
}

TEST_CASE("blocked splits and folds leave gaps between training and test records") {
  const Rows rows = all_rows(100);
  const Split s = make_split(rows, {.kind = "blocked"});
  CHECK(s.test.front() == 90);
  CHECK(s.validation.back() + 11 == s.test.front());
  CHECK(s.train.back() + 11 == s.validation.front());
  std::size_t tested = 0;
  for (std::size_t fold = 0; fold < 6; ++fold) {
    const Split f = make_fold(rows, fold, 6, 10);
    tested += f.test.size();
    for (const std::size_t t : f.train)
      for (const std::size_t e : f.test) REQUIRE((t > e ? t - e : e - t) > 10);
  }
  CHECK(tested == 100);
  CHECK_THROWS_AS(make_fold({0, 1, 2}, 0, 2, 10), Error);
  CHECK_THROWS_AS(make_split({0}, {}), Error);
}

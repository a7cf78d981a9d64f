// SPDX-License-Identifier: MIT

#include "recon/data/features.hpp"
#include "recon/data/split.hpp"
#include "world.hpp"

TEST_CASE(
    "two runs are loaded as one data set, but a copy of a run or a run with other axes is "
    "refused") {
  const Folder dir;
  a_run(3).write(dir / "a");
  a_run(2, 2).write(dir / "b");
  const Dataset data = load({dir / "a", dir / "b"});
  REQUIRE(data.size() == 5);
  CHECK(photons(data).rows == 5);
  CHECK(photons(data).cols == 30);
  CHECK(profiles(data).cols == 24);
  CHECK(depth_maps(data).cols == 4096);
  CHECK(values_of(data, &RecordInfo::index) == std::vector<std::int64_t>{0, 1, 2, 0, 1});
  CHECK(data.records[0].label == "person");
  REQUIRE(data.sources.size() == 2);
  CHECK(data.sources[1].first == 3);
  CHECK(data.sources[0].uuid != data.sources[1].uuid);
  const record::FusedRecord r = record::RunReader(dir / "b").read(1);
  CHECK(photons(data).row(4)[10] == static_cast<float>(counts(r)[10]));
  CHECK(profiles(data).row(4)[10] == power(r)[10]);
  CHECK(depth_maps(data).row(4)[30 * 64 + 32] == Approx(depth_mm(r)[30 * 64 + 32] * 1e-3));
  CHECK(load({dir / "a"}).hash == load({dir / "a"}).hash);
  CHECK(load({dir / "a"}).hash != load({dir / "b"}).hash);
  std::filesystem::copy_file(dir / "a", dir / "copy");
  CHECK_THROWS_WITH(load({dir / "a", dir / "copy"}), Catch::Contains("copy: is the same run as") &&
                                                         Catch::Contains("remove the copy"));
  a_run(2).radar({"radar", "power", "m", 24, 0, 0.5, 1}).write(dir / "c");
  CHECK_THROWS_WITH(load({dir / "a", dir / "c"}), Catch::Contains(dir / "c") &&
                                                      Catch::Contains("radar axis") &&
                                                      Catch::Contains(dir / "a"));
}

TEST_CASE("loading a calibrated run subtracts the calibration offsets from the ranges") {
  const Folder dir;
  a_run(2).write(dir / "a");
  const Dataset raw = load({dir / "a"});
  const double bins = 2, spd_m = bins * photons(raw).axis.step * speed_of_light_m_s / 2e12;
  a_run(2)
      .offset(Sensor::spd, spd_m)
      .offset(Sensor::radar, -profiles(raw).axis.step)
      .write(dir / "b");
  const Dataset moved = load({dir / "b"});
  CHECK(same_axis(photons(moved).axis, photons(raw).axis));
  for (std::size_t i = 0; i + 2 < photons(raw).cols; ++i)
    CHECK(photons(moved).row(1)[i] ==
          Approx(photons(raw).row(1)[i + 2]).epsilon(1e-3).margin(1e-3));
  CHECK(photons(moved).row(1)[photons(raw).cols - 1] == Approx(0).margin(1e-3));
  CHECK(profiles(moved).row(1)[0] == Approx(0).margin(1e-3));
  for (std::size_t i = 1; i < profiles(raw).cols; ++i)
    CHECK(profiles(moved).row(1)[i] ==
          Approx(profiles(raw).row(1)[i - 1]).epsilon(1e-3).margin(1e-3));
}

TEST_CASE("clicks per laser pulse are read from a record or derived from its counts") {
  const Folder dir;
  const auto clicks = [&](const char* name, std::uint64_t in_range, std::uint64_t starts,
                          std::optional<double> recorded) {
    a_run(1, 1, [&](FusedRecord& r) {
      r.spd_counts = {.starts = starts, .in_range = in_range};
      r.signal.clicks_per_pulse = recorded;
    }).write(dir / name);
    return load({dir / name}).records.at(0).clicks_per_pulse;
  };
  CHECK(clicks("a", 1020, 1000, 0.02) == 0.02);
  // Older runs do not store the number of clicks per pulse. If such a run contains equal numbers of
  // clicks and starts, the laser rate is unknown.
  CHECK(clicks("b", 1020, 1000, std::nullopt) == 0);
  CHECK(clicks("c", 999, 1000, std::nullopt) == 0);
  CHECK(clicks("d", 400, 1000, std::nullopt) == 0.4);
  CHECK(clicks("e", 1000, 0, std::nullopt) == 0);
}

TEST_CASE("records with a missing sensor keep their row and are excluded from training") {
  const Folder dir;
  a_run(8, 1, [](FusedRecord& r) {
    if (r.index == 2) lose(r, Sensor::spd);
    if (r.index == 3) lose(r, Sensor::radar);
    if (r.index == 5) lose(r, Sensor::depth);
  }).write(dir / "a");
  const Dataset data = load({dir / "a"});
  CHECK(data.size() == 8);
  CHECK(usable(data, Inputs::fused) == Rows{0, 1, 4, 6, 7});
  CHECK(usable(data, Inputs::spd) == Rows{0, 1, 3, 4, 6, 7});
  CHECK(usable(data, Inputs::radar) == Rows{0, 1, 2, 4, 6, 7});
}

TEST_CASE("a run is interpolated to the axes of another run if they differ by less than a bin") {
  const Folder dir;
  Axis near = radar_axis();
  near.start += 0.1;
  a_run(2).write(dir / "a"), a_run(2).radar(near).write(dir / "b");
  const Dataset data = load({dir / "a", dir / "b"});
  CHECK(same_axis(profiles(data).axis, radar_axis()));
  const auto first = profiles(data).row(0), moved = profiles(data).row(2);
  CHECK(moved[10] == Approx(0.4 * first[9] + 0.6 * first[10]));
}

TEST_CASE(
    "depths beyond the map range are treated as no return, and a wrong depth unit is refused") {
  const ReconFolder dir;
  const auto scaled = [](double by, std::int64_t every) {
    return [by, every](FusedRecord& r) {
      for (auto& mm : depth_mm(r))
        if (r.index % every == 0) mm = static_cast<std::uint16_t>(std::lround(mm * by));
    };
  };
  const auto said = [&](const std::string& name, const Change& change) {
    a_run(40, 1, change).write(dir / name);
    return dir.recon("train --model ridge --out " + name + "-m " + name);
  };
  CHECK_THAT(said("good", {}).text, !Catch::Contains("median"));
  const Outcome far = said("far", scaled(3, 2));
  CHECK(far.code == 0);
  CHECK_THAT(
      far.text,
      Catch::Contains("far: 20 of 40 records have depths beyond 6 m, treated as no return (") &&
          Catch::Contains("map_z_max_m"));
  const Dataset farther =
      load({a_run(40, 1, scaled(3, 2)).map({64, 0.55, 14}).write(dir / "farther")});
  CHECK(farther.map.far_m == 14);
  CHECK(std::ranges::max(depth_maps(farther).row(0)) > 6);
  const Outcome millimetres = said("mm", scaled(1e-3, 1));
  CHECK(millimetres.code == 1);
  CHECK_THAT(millimetres.text,
             Catch::Contains("mm: the median depth is 3 mm; expected metres") ||
                 Catch::Contains("mm: the median depth is 4 mm; expected metres"));
  CHECK_THAT(
      said("cm", scaled(0.1, 1)).text,
      Catch::Contains("cm: the median depth is 0.3") &&
          Catch::Contains(" m, but the histogram covers 2.4 to 4.2 m; expected depths in metres"));
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
  CHECK_THAT(error_of([&] { load({dir / "a"}); }), Catch::Contains("record 1"));
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
  CHECK_THAT(
      refused(spd, radar_axis(50), Inputs::fused),
      Catch::Contains("radar axis is 40") && Catch::EndsWith(": too short: 40 bins, expected 50"));
  CHECK_THAT(refused(spd, {"radar", "power", "m", 24, 0.3, 0.25, 1}, Inputs::radar),
             Catch::EndsWith(": start differs by 1.2 bins (limit 1)"));
  CHECK_THAT(refused(spd, {"radar", "power", "m", 24, 0, 0.2, 1}, Inputs::radar),
             Catch::EndsWith(": step differs: 6 bins at the end of the axis (limit 1)"));
  CHECK_THAT(refused(spd, {"radar", "power", "cm", 24, 0, 0.25, 1}, Inputs::radar),
             Catch::EndsWith(": quantity or unit differs"));
  CHECK_THAT(refused(spd, {"radar", "power", "m", 24, 0, 0.25, 2}, Inputs::radar),
             Catch::EndsWith(": scale is 1, expected 2"));
  CHECK_THAT(refused({"spd", "counts", "ps", 30, 16000, 500, 1}, radar_axis(40), Inputs::spd),
             Catch::Contains("spd axis"));
  // For a model that uses only the SPD, the radar axis is not checked.
  CHECK(refused(spd, radar_axis(50), Inputs::spd) == "no error");
}

TEST_CASE("records are interpolated to the model axis if the two axes differ by less than a bin") {
  Dataset data;
  photons(data).axis = Axis{"spd", "counts", "ps", 5, 100, 10, 1};
  profiles(data).axis = Axis{"radar", "power", "m", 4, 0, 0.5, 1};
  photons(data) = Matrix(0, 5), profiles(data) = Matrix(0, 4);
  photons(data).add_row(std::vector<float>{0, 10, 20, 40, 0});
  profiles(data).add_row(std::vector<float>{1, 2, 4, 8});
  data.records = {{.valid = SensorSet::from_bits(7)}};
  const Axis spd{"spd", "counts", "ps", 5, 104, 10, 1},
      radar{"radar", "power", "m", 4, -0.25, 0.5, 1};
  Dataset moved = data;
  match_axes(moved, {spd, radar}, Inputs::fused_profile);
  CHECK(photons(moved).values == std::vector<float>{4, 14, 28, 24, 0});
  CHECK(profiles(moved).values == std::vector<float>{1, 1.5, 3, 6});
  CHECK(same_axis(photons(moved).axis, spd));
  CHECK(same_axis(profiles(moved).axis, radar));
  CHECK_THAT(error_of([&] {
               match_axes(data, {Axis{"spd", "counts", "ps", 5, 111, 10, 1}}, Inputs::spd);
             }),
             Catch::Contains("spd axis is 5"));
}

TEST_CASE("summing radar power into wider bins preserves the total power") {
  const Axis paper = radar_bins(0.5);
  CHECK(paper.count == 14);
  CHECK(paper.at(-0.5) == 0);
  CHECK(paper.at(13.5) == 7);
  const auto profile = [](const Axis& axis, std::vector<float> power) {
    Dataset data;
    profiles(data).axis = axis;
    data.records = {{.valid = {Sensor::radar}}};
    profiles(data).cols = axis.count;
    profiles(data).add_row(power);
    return data;
  };
  SECTION("the power in wider bins is exact if the bin widths have an integer ratio") {
    std::vector<float> power(256);
    for (std::size_t i = 0; i < power.size(); ++i) power[i] = static_cast<float>(8 + i * i % 64);
    Dataset data = profile({"radar", "power", "m", 256, 0, 0.0625, 1}, power);
    rebin_radar(data, paper);
    REQUIRE(same_axis(profiles(data).axis, paper));
    // The model's range ends in the middle of the bin at 7 m (point 112), so only half of this bin
    // counts.
    double sum = 0, expected = power[112] / 2.0;
    for (std::size_t i = 0; i < 112; ++i) expected += power[i];
    for (const float v : profiles(data).row(0)) sum += v;
    CHECK(sum == expected);
    float first = power[8] / 2;
    for (std::size_t i = 0; i < 8; ++i) first += power[i];
    CHECK(profiles(data).row(0)[0] == first);
    float fourth = power[24] / 2 + power[32] / 2;
    for (std::size_t i = 25; i < 32; ++i) fourth += power[i];
    CHECK(profiles(data).row(0)[3] == fourth);
  }
  SECTION("the power in wider bins is exact to float precision for the bin widths of real chirps") {
    for (const double step : {0.0440950, 0.2502210, 0.25, 0.5}) {
      for (std::uint32_t at = 0; (at + 0.5) * step <= 7; ++at) {
        std::vector<float> power(256, 0.0f);
        power[at] = 3e7f;
        Dataset data = profile({"radar", "power", "m", 256, 0, step, 1}, power);
        rebin_radar(data, paper);
        double sum = 0, place = 0;
        for (std::uint32_t j = 0; j < 14; ++j) {
          sum += profiles(data).row(0)[j];
          place += profiles(data).row(0)[j] * paper.at(j) / 3e7;
        }
        REQUIRE(sum == Approx(3e7).epsilon(1e-7));
        REQUIRE(std::abs(place - at * step) <= 0.25 + 1e-6);
      }
    }
  }
  SECTION("a range profile that is coarser or shorter than the wider bins is refused") {
    Dataset coarse = profile({"radar", "power", "m", 24, 0, 0.6, 1}, std::vector<float>(24));
    CHECK_THAT(error_of([&] { rebin_radar(coarse, paper); }), Catch::Contains("cannot be summed"));
    Dataset near = profile({"radar", "power", "m", 24, 0, 0.25, 1}, std::vector<float>(24));
    CHECK_THAT(error_of([&] { rebin_radar(near, paper); }), Catch::Contains("cannot be summed"));
  }
}

TEST_CASE("a model trained on binned radar power accepts runs with unbinned power") {
  const ReconFolder dir;
  a_run(60).radar(radar_axis(40)).write(dir / "run");
  Dataset data = load({dir / "run"});
  match_axes(data, {photons(data).axis, radar_bins(0.5)}, Inputs::fused);
  CHECK(profiles(data).cols == 14);
  CHECK(profiles(data).axis.quantity == "binned_power");
  dir.done("train -q --model ridge --set fallback=false --set radar_bin_m=0.5 run --out m");
  dir.done("evaluate m run");
  dir.done("reconstruct -q m run --out maps");
  // The range axis of this run ends at 5.9 m, in front of the model's last bin.
  a_run(4).write(dir / "near");
  CHECK(dir.recon("evaluate m near").code == 1);
}

TEST_CASE("inputs scaled per record do not depend on sensor gains or a flat background") {
  const Dataset data = load_plates(40);
  const Rows rows = usable(data, Inputs::fused);
  const Features f = fit_features(data, rows, Inputs::fused, "record");
  Dataset changed = data;
  for (float& v : photons(changed).values) v = 4 * v + 50;
  for (float& v : profiles(changed).values) v *= 0.25f;
  const Matrix a = f.apply(data, rows), b = f.apply(changed, rows);
  for (std::size_t i = 0; i < a.values.size(); ++i)
    REQUIRE(b.values[i] == Approx(a.values[i]).margin(1e-3));
  const Features plain = fit_features(data, rows, Inputs::fused, "plain");
  CHECK(plain.apply(changed, rows).values[10] != Approx(plain.apply(data, rows).values[10]));
}

TEST_CASE("scaled inputs have zero mean and the same total variance for each sensor") {
  const Dataset data = load_plates(60);
  const Rows rows = usable(data, Inputs::fused);
  for (const auto& scaling : scaling_names) {
    const Matrix x = fit_features(data, rows, Inputs::fused, scaling).apply(data, rows);
    REQUIRE(x.cols == 54);
    double sum[2] = {0, 0}, mean = 0, size = 0;
    for (std::size_t i = 0; i < x.rows; ++i)
      for (std::size_t c = 0; c < x.cols; ++c) {
        sum[c >= 30] += std::pow(double{x.row(i)[c]}, 2) / 60;
        mean += x.row(i)[c];
        size += std::abs(x.row(i)[c]);
      }
    CAPTURE(scaling);
    CHECK(sum[0] == Approx(27).epsilon(1e-4));
    CHECK(sum[1] == Approx(27).epsilon(1e-4));
    // The mean of each column is rounded to a float. This rounding error is the same in all 60
    // rows.
    CHECK(std::abs(mean) < 60 * size * std::numeric_limits<float>::epsilon());
  }
}

TEST_CASE(
    "splits into training, validation and test records are reproducible and have the requested "
    "sizes") {
  const Rows rows = all_rows(4000);
  const Split s = make_split(rows, {});
  CHECK(s.test.size() == 400);
  CHECK(s.validation.size() == 180);
  CHECK(s.train.size() == 3420);
  CHECK(make_split(rows, {}).test == s.test);
  // The rows are sorted by the result of two steps of SplitMix64, initialised with the seed and the
  // row number. Other programs can reproduce this order.
  CHECK(drawn({0, 1, 2, 3, 4, 5, 6, 7}, 1, 0x73706c6974) == Rows{3, 1, 6, 7, 5, 2, 4, 0});
  SplitOptions other;
  other.seed = 2;
  CHECK(make_split(rows, other).test != s.test);
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
  const record::RunReader run(dir / "run");
  const Dataset data = load_part(run, 1, 5, sensors_of(Inputs::spd), {});
  REQUIRE(data.size() == 2);
  CHECK(data.has(0, Sensor::spd));
  CHECK_FALSE(data.has(0, Sensor::radar));
  CHECK_FALSE(data.has(0, Sensor::depth));
  CHECK(profiles(data).axis.count == 0);
  CHECK(profiles(data).values.empty());
  CHECK(depth_maps(data).values.empty());
  CHECK(photons(data).values.size() == 2 * spd_axis().count);
}

TEST_CASE("blocked splits and folds leave gaps between training and test records") {
  const Rows rows = all_rows(100);
  SplitOptions options;
  options.kind = "blocked";
  const Split s = make_split(rows, options);
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

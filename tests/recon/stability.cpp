// SPDX-License-Identifier: MIT
// Where models fail: the table of conditions, the rule of losing, and the whole study.
#include "recon/study/stability.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <set>
#include <sstream>

#include "recon/data/files.hpp"
#include "recon/study/simulate.hpp"
#include "recon/study/study.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;
using Catch::Contains;

namespace {

constexpr double undefined = std::numeric_limits<double>::quiet_NaN();

Measurement row(const std::string& value, const std::string& model, std::size_t seed, double iou,
                double ssim_hard) {
  const bool base = value == "20";
  return {base ? "base" : "shifted-snr",
          base ? "base" : value,
          model,
          model == "silhouette" ? "fused" : "-",
          seed,
          {{"iou", iou}, {"ssim_hard", ssim_hard}}};
}

struct Score {
  const char* value;
  double iou, ssim_hard;
};

// The rows of a model over the axis shifted-snr of two seeds, beside an empty room of 0.81.
std::vector<Measurement> rows_of(const std::vector<Score>& scores) {
  std::vector<Measurement> rows;
  for (const Score& s : scores)
    for (const std::size_t seed : {1u, 2u}) {
      const double noise = seed == 1 ? 0.001 : -0.001;
      rows.push_back(row(s.value, "empty", seed, 0, 0.81));
      rows.push_back(row(s.value, "mean", seed, 0.05, 0.80));
      rows.push_back(row(s.value, "silhouette", seed, s.iou + noise, s.ssim_hard + noise));
    }
  return rows;
}

const BaseCondition& base_condition() {
  static const BaseCondition base =
      Simulator(echofuse::test::bin_dir + "/echofuse-sim", "", 0).base_condition();
  return base;
}

StabilityCurve curve_of(const std::vector<Measurement>& rows) {
  StabilityOptions options;
  options.base = base_condition();
  options.models = {"silhouette"}, options.axes = {"shifted-snr"};
  const auto results = summarise_stability(options, rows);
  REQUIRE(results.size() == 1);
  REQUIRE(results[0].baselines.size() == 2);
  return results[0].curves.at(0);
}

using Labels = std::vector<std::string>;

std::vector<std::string> lines_of(const std::string& path) {
  std::ifstream in(path);
  std::vector<std::string> out;
  for (std::string line; std::getline(in, line);) out.push_back(line);
  return out;
}

std::string text_of(const std::string& path) {
  std::ifstream in(path);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

// The mean over the seeds of the IoU of these lines.
double iou_of(const std::vector<std::string>& lines, const std::string& begin, int seeds = 2) {
  double sum = 0, count = 0;
  for (const auto& line : lines)
    if (line.starts_with(begin)) sum += std::stod(line.substr(begin.size() + 2)), ++count;
  REQUIRE(count == seeds);
  return sum / count;
}

}  // namespace

TEST_CASE("every axis of stability has one base, and its names fit into table and files") {
  for (const bool quick : {false, true}) {
    std::set<std::string> ids;
    for (const StabilityAxis& axis : stability_axes(base_condition(), quick)) {
      CAPTURE(axis.id());
      CHECK(ids.insert(axis.id()).second);
      CHECK(axis.values.size() >= 2);
      std::set<std::string> labels;
      int bases = 0;
      for (const AxisValue& v : axis.values) {
        CHECK(labels.insert(v.label).second);
        CHECK(v.label.find_first_of(",\"\n") == std::string::npos);
        bases += v.world.base();
        // Trained elsewhere, a model could not read records of other axes.
        for (const auto& set : v.world.set)
          if (!axis.matched) CHECK_THAT(set, !Contains("bin") && !Contains("radar_step"));
      }
      CHECK(bases == 1);
    }
    CHECK(ids.size() == stability_axes(base_condition(), !quick).size());
  }
}

TEST_CASE("the axes follow the simulator's base condition") {
  BaseCondition base = base_condition();
  const auto values = [&](const std::string& id) -> std::vector<AxisValue> {
    for (const StabilityAxis& axis : stability_axes(base, false))
      if (axis.id() == id) return axis.values;
    return {};
  };
  base.at("bins") *= 2, base.at("signal_photons") = 1e4;
  CHECK(values("matched-bin_width").at(0).world.set ==
        std::vector<std::string>{"bin_width_ps=10", "bins=6720"});
  CHECK(values("matched-photons").at(2).world.base());
  CHECK(values("shifted-spd_gain").at(0).world.set ==
        std::vector<std::string>{"signal_photons=2500"});
  CHECK(values("matched-slot").back().world.set ==
        std::vector<std::string>{"window_s=0.05", "signal_photons=166.666667",
                                 "background_counts=0", "radar_frames=1"});
  base.at("radar_antennas") = 8;
  CHECK(values("matched-slot").back().label == "0.5");  // 9 frames are in 0.45 s
  base.at("irf_fwhm_ps") = 123;
  CHECK_THROWS_WITH(stability_axes(base, true),
                    "axis matched-irf has no value for the simulator's "
                    "base: 123");
  base.erase("irf_fwhm_ps");
  CHECK_THROWS_WITH(stability_axes(base, true), "the simulator has no number \"irf_fwhm_ps\"");
}

TEST_CASE("with antennas in the base condition there are axes of them, and rows without them") {
  StabilityOptions options;
  options.sim = echofuse::test::bin_dir + "/echofuse-sim";
  options.set = {"radar_antennas=8", "radar_sum=coherent"};
  options.axes = {"matched-antennas", "shifted-antennas", "shifted-phase",
                  "shifted-speckle",  "matched-carriers", "shifted-motion"};
  options = complete(options);
  CHECK(options.models.at(1) == options.models.at(0) + ":fused-profile");
  const auto axes = axes_of(options);
  CHECK(axes.at(0).values.at(axes.at(0).base()).label == "8");
  CHECK(axes.at(1).values.at(1).world.set == Labels{"radar_antennas=1"});
  CHECK(axes.at(2).values.at(axes.at(2).base()).label == "0");
  CHECK(axes.at(3).values.at(axes.at(3).base()).label == "coherent 50 cm");
  CHECK(axes.at(4).values.at(2).world.set == Labels{"radar_carriers=4"});
  CHECK(axes.at(5).values.back().world.set ==
        Labels{"radar_sway_m=0", "radar_twist_deg=0", "radar_breath_m=0"});
  options.set.clear(), options.models.clear();
  CHECK_THAT(error_of([&] { complete(options); }), Contains("axis \"shifted-antennas\""));
}

TEST_CASE("study stability with the radar's antennas: fewer, lost, and their profile beside",
          "[.]") {
  const Folder dir;
  const Outcome study = recon_program(
      "study stability -q --quick --set radar_antennas=8 --set radar_sum=coherent --seeds 1 "
      "--records 200 --test-records 30 --models silhouette,silhouette:fused-profile --axes "
      "shifted-antennas --out " +
      (dir / "out"));
  CAPTURE(study.text);
  REQUIRE(study.code == 0);
  const auto lines = lines_of(dir / "out/stability.csv");
  const double lost = iou_of(lines, "shifted-antennas,lost,silhouette,fused,-,", 1);
  CHECK(lost < 0.8 * iou_of(lines, "base,base,silhouette,fused,-,", 1));
  CHECK(lost == iou_of(lines, "shifted-antennas,lost,silhouette,fused-profile,-,", 1));
}

TEST_CASE("a lost sensor is zeros, and missing if it is said to be") {
  Dataset data = load_plates(3), zeros = data;
  apply({.damage = Damage::radar_missing}, data);
  CHECK(data.usable(Inputs::fused).empty());
  CHECK(data.usable(Inputs::spd).size() == 3);
  apply({.damage = Damage::spd_zero}, zeros);
  CHECK(zeros.usable(Inputs::fused).size() == 3);
  CHECK(std::count(zeros.spd.values.begin(), zeros.spd.values.end(), 0.f) ==
        static_cast<std::ptrdiff_t>(zeros.spd.values.size()));
  const float before = zeros.radar.values[5];
  apply({.radar_gain = 4}, zeros);
  CHECK(zeros.radar.values[5] == 4 * before);
}

TEST_CASE("a model fails where its map is no better than no map") {
  using Scores = std::vector<Score>;
  SECTION("it never does") {
    const auto c = curve_of(rows_of(Scores{
        {"30", .6, .87}, {"20", .6, .87}, {"10", .5, .85}, {"5", .45, .84}, {"0", .36, .82}}));
    CHECK(c.fails_at.empty());
    CHECK(c.halved_at.empty());
    CHECK(c.worst == Approx(0.6));
  }
  SECTION("by its hard SSIM, and the first value counts, though a later one is better") {
    const auto c = curve_of(rows_of(Scores{
        {"30", .6, .87}, {"20", .6, .87}, {"10", .29, .85}, {"5", .3, .80}, {"0", .4, .82}}));
    CHECK(c.fails_at == Labels{"5"});
    CHECK(c.halved_at == Labels{"10"});
  }
  SECTION("by its IoU, which must beat the mean map by more than the spread; on both sides") {
    const auto c = curve_of(rows_of(Scores{
        {"30", .051, .87}, {"20", .6, .87}, {"10", .053, .85}, {"5", .051, .85}, {"0", .4, .82}}));
    CHECK(c.fails_at == Labels{"30", "5"});
    CHECK(c.halved_at == Labels{"30", "10"});
    CHECK(c.worst == Approx(0.085));
  }
  SECTION("a map must be better than none by more than the spread") {
    const auto c = curve_of(rows_of(Scores{
        {"30", .6, .87}, {"20", .6, .87}, {"10", .6, .8105}, {"5", .6, .87}, {"0", .6, .80}}));
    CHECK(c.fails_at == Labels{"10"});
  }
  SECTION("without a map") {
    const auto c = curve_of(rows_of(Scores{{"30", .6, .87},
                                           {"20", .6, .87},
                                           {"10", .5, .85},
                                           {"5", .5, .85},
                                           {"0", undefined, undefined}}));
    CHECK(c.fails_at == Labels{"0"});
    CHECK(c.worst == 0);
  }
  SECTION("at the base already") {
    const auto c = curve_of(rows_of(Scores{
        {"30", .6, .87}, {"20", .01, .87}, {"10", .5, .85}, {"5", .5, .85}, {"0", .5, .85}}));
    CHECK(c.fails_at == Labels{"20"});
    CHECK(c.halved_at.empty());
    CHECK(std::isnan(c.worst));
  }
}

TEST_CASE("where nobody is, inventing nobody is no failure, and a ghost does") {
  for (const bool ghost : {false, true}) {
    auto rows = rows_of({{"30", .6, .87}, {"20", .6, .87}, {"10", .6, .86}, {"5", .6, .86}});
    for (const std::size_t seed : {1u, 2u}) {
      rows.push_back(row("0", "empty", seed, undefined, 1));
      rows.push_back(row("0", "mean", seed, undefined, 1));
      rows.push_back(row("0", "silhouette", seed, ghost ? 0 : undefined, ghost ? 0.97 : 1));
    }
    const auto c = curve_of(rows);
    CHECK(c.fails_at == (ghost ? Labels{"0"} : Labels{}));
    CHECK(c.worst == Approx(1));
  }
}

TEST_CASE("study stability: a small one, cut and continued, and refused with other settings") {
  const Folder dir;
  const std::string out = dir / "out", table = out + "/stability.csv";
  const std::string study =
      "study stability -q --quick --seeds 2 --test-records 24 --out " + out +
      " --axes matched-side,shifted-radar_offset --models silhouette,nearest" + " --records ";
  const Outcome first = recon_program(study + "160");
  CAPTURE(first.text);
  REQUIRE(first.code == 0);
  const auto lines = lines_of(table);
  CHECK(lines.size() == 7 + 2 * (1 + 1 + 3) * 4);  // seeds x values x models
  const double base = iou_of(lines, "base,base,silhouette,fused,-,");
  CHECK(base > 0.3);
  CHECK(iou_of(lines, "shifted-radar_offset,0.2,silhouette,fused,-,") < 0.3 * base);
  CHECK_THAT(first.text, Contains("shifted-radar_offset       silhouette"));
  const std::string page = text_of(out + "/stability.html");
  CHECK_THAT(page, Contains("What fails first") && Contains("silhouette: fails at ") &&
                       Contains("half at 0.05") &&
                       Contains("best baseline: nearest training record"));
  CHECK(page.find(", shifted\"") < page.find(", matched\""));
  CHECK(std::distance(std::filesystem::directory_iterator(out), {}) == 2);

  const std::string whole = text_of(table);
  std::filesystem::resize_file(table, whole.size() * 2 / 3);
  const Outcome second = recon_program(study + "160");
  CHECK(second.code == 0);
  CHECK(second.text == first.text);
  CHECK(text_of(table) == whole);

  const Outcome other = recon_program(study + "170");
  CHECK(other.code == 3);
  CHECK_THAT(
      other.text,
      Contains("stability.csv: was measured with \"# records 160\" (now: \"# records 170\"); "));
  CHECK(text_of(table) == whole);
}

TEST_CASE("study stability: a lost radar is replaced, and nobody is shown where nobody is", "[.]") {
  const Folder dir;
  const std::string out = dir / "out";
  const Outcome study = recon_program(
      "study stability -q --quick --seeds 2 --records 260 --test-records 60 --models factorised-4 "
      "--axes shifted-scenes,shifted-lost_radar --out " +
      out);
  CAPTURE(study.text);
  REQUIRE(study.code == 0);
  const auto lines = lines_of(out + "/stability.csv");
  CHECK(iou_of(lines, "base,base,factorised-4,fused,-,") > 0.4);
  // The SPD alone does not know the side, but it answers: without it there would be no number.
  CHECK(iou_of(lines, "shifted-lost_radar,missing,factorised-4,fused,-,") >= 0);
  // Where nobody is, it shows nobody: a hard SSIM of 1, as the empty room.
  for (const char* seed : {"1", "2"}) {
    const std::string begin = std::string("shifted-scenes,nobody,factorised-4,fused,-,") + seed;
    CHECK(std::ranges::count_if(lines, [&](const std::string& line) {
            return line.starts_with(begin + ",nan,nan,1,");
          }) == 1);
  }
}

TEST_CASE("a record that a model cannot read shows the empty room") {
  Dataset data = load_plates(60);
  const TrainedModel model = train_on_all(data, StudyModel("nearest"), 1);
  std::fill(data.spd.row(7).begin(), data.spd.row(7).end(), 0.f);
  Rows rows = all_rows(data.size());
  std::erase_if(rows, [&](std::size_t row) { return !model.fault_of(data, row).empty(); });
  REQUIRE(rows.size() == 59);
  const Matrix maps = predict_or_empty_room(model, prepare_records(model, data), rows),
               made = model.predict(data, rows);
  REQUIRE(maps.rows == 60);
  CHECK(std::ranges::equal(maps.row(7), model->scene.background));
  CHECK(std::ranges::equal(maps.row(6), made.row(6)));
  CHECK(std::ranges::equal(maps.row(59), made.row(58)));
  CHECK_FALSE(std::ranges::equal(maps.row(8), model->scene.background));
}

TEST_CASE("a study's models have beside them what it asks for, and nothing else") {
  const Dataset data = load_plates(120);
  const StudyModel silhouette("silhouette"), mean("mean");
  const TrainedModel alone = train_on_all(data, silhouette, 1);
  CHECK_FALSE(alone->uncertainty);
  CHECK(alone.estimators.size() == 1);
  const TrainedModel with_parts = train_on_all(data, silhouette, 1, true);
  CHECK(with_parts->uncertainty);
  CHECK(with_parts.estimators.size() == 2);
  CHECK(train_on_all(data, mean, 1, true).estimators.size() == 1);
}

TEST_CASE("study stability says once why a training is refused") {
  const Folder dir;
  const Outcome study = recon_program(
      "study stability -q --seeds 2 --records 20 --test-records 10 --models silhouette --axes "
      "matched-records --out " +
      (dir / "out"));
  CAPTURE(study.text);
  REQUIRE(study.code == 0);
  const std::string reason = "\nsilhouette: 1 usable records leave 1";
  const auto at = ("\n" + study.text).find(reason);
  REQUIRE(at != std::string::npos);
  CHECK(study.text.find(reason, at) == std::string::npos);
}

TEST_CASE("a temporary run file goes with what is kept beside it") {
  const Folder dir;
  {
    const TemporaryFile file{dir / "a.sqlite"};
    for (const char* beside : {"", "-wal", "-shm", "-lock"})
      std::ofstream(file.path + beside) << "x";
  }
  CHECK(std::filesystem::is_empty(dir.path));
}

TEST_CASE("study stability says what it cannot do") {
  const Folder dir;
  const std::string study = "study stability -q --quick --out " + (dir / "out");
  const Outcome axis = recon_program(study + " --axes shifted-weather");
  CHECK(axis.code == 2);
  CHECK_THAT(axis.text, Contains("shifted-weather") && Contains("shifted-snr, "));
  const Outcome model = recon_program(study + " --models silhouette:spd");
  CHECK(model.code == 2);
  CHECK_THAT(model.text, Contains("needs both sensors"));
  const Outcome inputs = recon_program(study + " --models mlp-512-256:rader");
  CHECK(inputs.code == 2);
  CHECK_THAT(inputs.text, Contains("rader"));
  CHECK_FALSE(std::filesystem::exists(dir / "out"));
  const Outcome sim = recon_program(study + " --models mean --sim " + (dir / "nowhere"));
  CHECK(sim.code == 1);
  CHECK_THAT(sim.text, Contains("No such file") && Contains("--sim"));
  const Outcome fails = recon_program(study + " --models mean --sim false");
  CHECK(fails.code == 1);
  CHECK_THAT(fails.text, Contains(": exit code 1\n"));
  std::ofstream(dir / "dies") << "#!/bin/sh\nkill -9 $$\n";
  std::filesystem::permissions(dir / "dies", std::filesystem::perms::owner_all);
  CHECK_THAT(recon_program(study + " --models mean --sim " + (dir / "dies")).text,
             Contains(": ended by signal 9\n"));
}

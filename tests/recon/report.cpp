// SPDX-License-Identifier: MIT
// A report tells failures first, and only what was measured.
#include "page_data.hpp"
#include "recon/page/report_page.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

namespace {

// Returns the scores of 20 records that vary a little about these.
Evaluation evaluation_of(const std::string& model, double iou, double rmse_m) {
  Evaluation e;
  e.model = model, e.records = 20;
  for (std::size_t i = 0; i < e.records; ++i) {
    MapScores s;
    s.fill(std::nan(""));
    const double wobble = 0.001 * static_cast<double>(i % 3);
    s[metric_iou] = iou + wobble, s[metric_rmse_m] = rmse_m + wobble;
    s[metric_lateral_m] = 0.03 + wobble, s[metric_depth_mae_m] = 0.1 + wobble;
    e.rows.push_back(i), e.scores.push_back(s);
    e.uncertainties.push_back({0.1, {}});
  }
  e.metrics = summarise(e.scores);
  return e;
}

Report report_of(const std::vector<std::pair<std::string, Evaluation>>& modes) {
  Report out;
  out.records = 20, out.simulated = out.new_run = true;
  for (const auto& [name, e] : modes) {
    ModeResult mode;
    mode.name = name, mode.evaluations = {e}, mode.metrics = e.metrics, mode.takes = "SPD alone";
    mode.models.emplace_back();
    for (std::size_t i = 0; i < e.records; ++i)
      mode.records.push_back({static_cast<std::int64_t>(i), "letter:A", 3, 0.1});
    out.modes.push_back(mode);
  }
  out.baselines = {{"empty", evaluation_of("empty", 0, 0.6).metrics}};
  return out;
}

}  // namespace

TEST_CASE("the verdict names an opponent that draws a body, and what is worse") {
  Report report = report_of({{"ours", evaluation_of("factorised", 0.6, 0.46)},
                             {"theirs", evaluation_of("mlp", 0.5, 0.42)}});
  const std::string alone = verdict(report);
  CHECK_THAT(alone, Catch::Contains("IoU 0.60 \u00b1 0.00 (theirs, of the same inputs: 0.50") &&
                        Catch::Contains("none of the baselines scored here draws a body") &&
                        Catch::Contains("20 simulated records of a new run") &&
                        Catch::Contains("lateral error 3.1") && !Catch::Contains("empty room"));
  CHECK_THAT(alone,
             Catch::Contains("Worse than theirs (mlp, SPD alone) in RMSE (0.46 against 0.42 m)"));
  report.modes[1].takes = "SPD + 8 antennas";
  CHECK_THAT(verdict(report), !Catch::Contains("same inputs"));
  report.baselines.push_back({"nearest", evaluation_of("nearest", 0.3, 0.5).metrics});
  report.simulated = report.new_run = false;
  CHECK_THAT(verdict(report), Catch::Contains("nearest training record: 0.30") &&
                                  Catch::Contains("20 recorded records that training held out"));
}

TEST_CASE("what fails stands first, of the live run before all") {
  Report report = report_of({{"fused", evaluation_of("factorised", 0.6, 0.46)}});
  CHECK(problems_of(report).empty());
  report.live = evaluation_of("factorised", 0.6, 0.46);
  for (auto& u : report.live->uncertainties) u.lateral_interval_90_m = 0.01;
  report.live->domain_shift.records = 20;
  report.live->domain_shift.p = 1e-4;
  report.live->domain_shift.differences = {{"range +30.0 +- 2.0 cm", 15}};
  report.story.emplace(), report.story->info.window_s = 0.2, report.window_s = 3;
  const auto problems = problems_of(report);
  REQUIRE(problems.size() == 3);
  CHECK_THAT(problems[2].text, Catch::Contains("0.2 s long, those of the scored run 3 s"));
  CHECK_THAT(problems[0].text, Catch::Contains("Recorded run: this run is unlike the training"));
  CHECK_THAT(problems[1].text, Catch::Contains("only 0 of 20 records; it is stated for 90 % (18)"));
  report.baselines.push_back({"mean", evaluation_of("mean", 0, 0.6).metrics});
  const Json page = page_of(report);
  CHECK(page["fails"].size() == 3);
  CHECK_THAT(page["fails"][0].get<std::string>(), Catch::Contains("unlike the training"));
  CHECK(page["more"] == "Numbers, and which records");
  CHECK(page["sections"][0]["id"] == "failures");
  CHECK_THAT(page["verdict"].get<std::string>(), Catch::Contains("20 simulated records"));
}

TEST_CASE("among equals all are best, a ghost is best near 0, and counts are counts") {
  Evaluation better = evaluation_of("factorised", 0.6, 0.46),
             worse = evaluation_of("mlp", 0.5, 0.42);
  for (std::size_t i = 0; i < 20; ++i) {
    better.scores[i][metric_ghost] = 0, worse.scores[i][metric_ghost] = -0.1;
    better.scores[i][metric_left_right] = worse.scores[i][metric_left_right] = i > 0;
  }
  better.metrics = summarise(better.scores), worse.metrics = summarise(worse.scores);
  const Json all = all_table(report_of({{"fused", better}, {"paper", worse}}))[0]["rows"];
  CHECK(all[3][0]["small"] == "0 is best");
  CHECK(all[3][1] == cell("0", "", "best"));
  CHECK(all[3][2]["text"] == "-0.10");
  for (const int model : {1, 2}) CHECK(all[4][model] == cell("19 of 20", "", "best"));
  CHECK(CountOf{0, 10}.interval().first == 0);
  CHECK(CountOf{5, 10}.interval().first == Approx(0.2366).epsilon(0.001));  // Wilson, by hand
}

TEST_CASE("a model that asks no sensor does not stand for one") {
  const Folder dir;
  write_run(dir / "run", 80);
  for (const std::string how : {"ridge --inputs fused", "mean --inputs spd"})
    REQUIRE(recon_program("train -q --set fallback=false --model " + how + " " + (dir / "run") +
                          " --out " + (dir / how.substr(0, how.find(' '))))
                .code == 0);
  const std::string report = "report " + (dir / "out") + " --run " + (dir / "run") + " --model " +
                             (dir / "ridge") + " --model " + (dir / "mean");
  const Outcome o = recon_program(report);
  REQUIRE(o.code == 0);
  CHECK_THAT(o.text, Catch::Contains("mean (no sensor)"));
  const std::string page = page_data(dir / "out/report.html").dump();
  for (const char* claim : {"0.6389", "A sensor alone leaves open", "SPD alone"})
    CHECK(page.find(claim) == std::string::npos);
  // To another room only what places a body can be taken.
  const Outcome room = recon_program(report + " --empty " + (dir / "run"));
  CHECK(room.code == 1);
  CHECK_THAT(room.text,
             Catch::Contains("ridge does not place a body: it cannot be taken to another room"));
}

TEST_CASE("rows of equal inputs stand together, each model by its own name") {
  const Folder dir;
  write_run(dir / "run", 120);
  for (const std::string how :
       {"ridge", "ridge-spd --inputs spd", "mlp-256-128 --epochs 2", "mlp-512-256 --epochs 2"}) {
    const std::string name = how.substr(0, how.find(' '));
    REQUIRE(recon_program("train -q --set fallback=false --model " +
                          (name == "ridge-spd" ? "ridge --inputs spd" : how) + " " + (dir / "run") +
                          " --out " + (dir / name))
                .code == 0);
  }
  const Outcome o = recon_program(
      "report " + (dir / "out") + " --run " + (dir / "run") + " --model " + (dir / "ridge") +
      " --model " + (dir / "ridge-spd") + " --model small=" + (dir / "mlp-256-128") + " --model " +
      (dir / "mlp-512-256") + " --model " + (dir / "ridge"));
  REQUIRE(o.code == 0);
  const Json rows = page_data(dir / "out/report.html")["first"][1]["rows"];
  std::vector<std::string> names;
  for (const Json& row : rows) names.push_back(row[0]);
  REQUIRE(names.size() > 4);
  names.resize(4);
  CHECK(names == std::vector<std::string>{"ridge (SPD + radar profile; 2 trainings)",
                                          "small (mlp, SPD + radar profile)",
                                          "mlp-512-256 (the paper's network, SPD + radar profile)",
                                          "ridge-spd (ridge, SPD alone)"});
}

TEST_CASE("a report of models of the SPD alone needs no radar") {
  const Folder dir;
  write_run(dir / "run", 120, 1, [](record::FusedRecord& r) {
    r.radar.clear();
    r.valid.erase(Sensor::radar);
  });
  REQUIRE(recon_program("train -q --model ridge --inputs spd " + (dir / "run") + " --out " +
                        (dir / "spd"))
              .code == 0);
  const Outcome o = recon_program("report " + (dir / "out") + " --run " + (dir / "run") +
                                  " --model " + (dir / "spd") + " --live " + (dir / "run"));
  CAPTURE(o.text);
  REQUIRE(o.code == 0);
  CHECK_THAT(o.text, Catch::Contains("spd (ridge, SPD alone), on "));
}

TEST_CASE("maps are packed in whole numbers, and a page's text cannot end its script") {
  const std::vector<float> values{0, 1.2345f, -1, 99, std::nanf("")};
  CHECK(packed16(values, 1e-3) == "AADTBAAA//8AAA==");  // 0, 1235 (0x04d3), 0, 65535, 0
  CHECK(packed8(values, 0.01) == "AHsA/wA=");           // 0, 123, 0, 255, 0
  CHECK(short_number(std::nan("")).is_null());
  CHECK(short_number(0.123456789) == 0.12346);
  const std::string html = html_of(new_page("<!--<script>", "</script>\u202e", ""));
  CHECK_THAT(html, Catch::Contains(R"("title":"\u003c!--\u003cscript>")"));
  CHECK_THAT(html, Catch::Contains(R"("verdict":"\u003c/script>\\u202e")"));
}

TEST_CASE("a shown record says what was measured, and where a sensor was missing") {
  ShownRecord shown;
  shown.title = "person, record 3", shown.truth = {0, 2}, shown.half_tangent = 0.5;
  shown.spd_axis = spd_axis(), shown.radar_axis = radar_axis(), shown.body_m = std::nan("");
  shown.clicks = {5, 7};
  shown.maps = {{"both sensors", {0, 3}, {}, {0, 1}, {}, "within 8 cm", ""}};
  const Json json = json_of(shown);
  CHECK(json["spd"]["clicks"] == Json{5, 7});
  CHECK(!json["radar"].contains("db"));
  CHECK(json["body_m"].is_null());
  CHECK(!json["maps"][0].contains("deviation"));
  CHECK(json["maps"][0]["map"] == "AAC4Cw==");  // 0 and 3000 mm
}

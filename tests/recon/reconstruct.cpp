// SPDX-License-Identifier: MIT
// Tests the output files of `reconstruct`, and a run that is reconstructed while it is recorded.

#include <map>

#include "drivers/core/clock.hpp"
#include "recon/maps/map_files.hpp"
#include "recon/maps/written_maps.hpp"
#include "world.hpp"

namespace {

// Runs one line of Python with NumPy in the folder, and returns its output.
std::string numpy(const ReconFolder& dir, const std::string& line) {
  return dir.run("/usr/bin/python3 -c \"import numpy as n; " + line + "\"").text;
}

std::vector<float> points_of(const std::string& ply) {
  const std::string last = "end_header\n";
  const auto at = ply.find(last);
  REQUIRE(at != std::string::npos);
  CHECK_THAT(ply, StartsWith("ply\nformat binary_little_endian 1.0\n"));
  const Bytes raw(ply.begin() + static_cast<std::ptrdiff_t>(at + last.size()), ply.end());
  CHECK_THAT(ply, Contains("element vertex " + std::to_string(raw.size() / 15) + "\nproperty"));
  CHECK_THAT(ply, Contains("x right, y down, z away"));
  CHECK(raw.size() % 15 == 0);
  Bytes places;  // bytes of the point coordinates only, not of the colours
  for (std::size_t i = 0; i < raw.size(); ++i)
    if (i % 15 < 12) places.push_back(raw[i]);
  return to_values<float>(places);
}

template <class Condition>
void wait_for(const std::string& what, const Condition& condition) {
  for (int i = 0; i < 2000 && !condition(); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  INFO(what);
  REQUIRE(condition());
}

}  // namespace

TEST_CASE("random maps of any size are read back as written, as an array and as pictures") {
  const auto size = GENERATE(take(6, random(3U, 70U)));
  const auto seed = GENERATE(take(2, random(0U, 1000U)));
  CAPTURE(size, seed);
  Rng rng = make_rng(seed, size);
  std::uniform_real_distribution<float> depth_m(0.1F, 5.9F);
  std::bernoulli_distribution none(0.3);
  recon::SceneModel scene;
  scene.grid = {.size = size, .half_tangent = 0.3 + 0.01 * size, .far_m = 6};
  const std::size_t pixels = std::size_t{size} * size;
  scene.background.assign(pixels, 0), scene.mean_map.assign(pixels, 0);
  const Folder dir;
  std::map<std::int64_t, std::vector<float>> expected;
  for (const char* format : {"npy", "mm"}) {
    std::filesystem::create_directory(dir / format);
    recon::MapFiles files(dir / format, {format}, scene);
    std::string table = "record,status\n";
    for (const std::int64_t index : {0L, 3L, 4L, 1234567L}) {
      std::vector<float>& map = expected[index];
      if (map.empty()) map.resize(pixels);
      if (std::string(format) == "npy")
        std::ranges::generate(map, [&] { return none(rng) ? 0 : depth_m(rng); });
      files.write(files.prepare(index, map, {}));
      table += std::to_string(index) + ",ok\n" + std::to_string(index + 10) + ",radar missing\n";
    }
    files.close();
    std::ofstream(dir / format + "/records.csv") << table;
    const recon::WrittenMaps read = recon::read_written_maps(dir / format, scene.grid);
    REQUIRE(read.of_index.size() == expected.size());
    const double step_m = std::string(format) == "mm" ? 0.5e-3 : 0;
    for (const auto& [index, map] : expected) {
      const std::vector<float> shown = recon::within_span(map, scene),
                               &found = read.of_index.at(index);
      for (std::size_t i = 0; i < pixels; ++i)
        REQUIRE(double{std::abs(found[i] - shown[i])} <= 1.01 * step_m);
    }
    if (step_m == 0) CHECK(read.without.size() == expected.size());
  }
}

TEST_CASE("the status of a predicted map names the doubtful input sensors") {
  const ReconFolder dir;
  a_run(4, 2, [](FusedRecord& r) {
    if (r.index == 1) set_verdict(r, Sensor::spd, "weak: 12 clicks above the background");
    if (r.index == 2) set_verdict(r, Sensor::depth, "stands still: the same as before");
    if (r.index == 3) set_verdict(r, Sensor::radar, "no peak: no bins clearly exceed the mean");
  }).write(dir / "fresh");
  dir.says("reconstruct --format npy " + made_model("ridge", 60) + " fresh --out o",
           {"\no: 4 records reconstructed, 0 left out; 1 with doubtful data: SPD weak"});
  const std::string csv = contents(dir / "o/records.csv");
  for (const char* line : {"\n0,\"ok\",", "\n1,\"ok; SPD weak\",", "\n2,\"ok\",", "\n3,\"ok\","})
    CHECK_THAT(csv, Contains(line));
  dir.says("-q evaluate --maps o fresh --train " + made_run(60),
           {"\n2 records; ", "\n2 of 4 records left out: SPD weak 1, camera stands still 1\n"});
  // Only maps that state their training records may be scored on a training run.
  std::filesystem::copy(dir / "o", dir / "stated");
  std::ofstream(dir / "stated/run.txt", std::ios::app) << "trained on records 0,1\n";
  std::filesystem::remove(dir / "o/run.txt");
  const std::string on_itself = "-q evaluate fresh --train fresh --maps ";
  dir.done(on_itself + "stated");
  for (const std::string maps : {"o", "stated --maps o"})
    dir.refuses(on_itself + maps, 1, "is a training run; score another run");
}

TEST_CASE("written maps get the same scores as their model, and invalid map files are refused") {
  const ReconFolder dir;
  const std::string run = made_run(120), model_file = made_model("ridge", 120, 1, {});
  a_run(20, 2).write(dir / "fresh");
  dir.done("reconstruct -q --format npy,mm " + model_file + " fresh --out o");
  const auto assessed = [&](const std::string& what) {
    const auto json = dir.json("evaluate " + what + " fresh --train " + run);
    return std::pair(json["metrics"], json["trivial"]);
  };
  CHECK(assessed(model_file) == assessed("--maps o"));
  dir.refuses("evaluate --maps o " + run, 1, "o: contains maps of another run, ");
  const auto array = [](const std::string& values) { return "n.save('maps.npy', " + values + ")"; };
  const auto camera = [](const std::string& change) {
    return "import json; os.remove('maps.npy'); c = json.load(open('camera.json')); " + change +
           "; json.dump(c, open('camera.json', 'w'))";
  };
  const std::string unscaled = "camera.json: expected positive width, fx and depth_scale";
  // Each row contains a change of the files in Python, and the words of the refusal.
  for (const auto& [change, words] : std::vector<std::pair<std::string, std::string>>{
           {array("m * 1000"), "expected metres, not millimetres"},
           {array("m[:, ::2, ::2].copy()"), "maps have 32 x 32 pixels; expected 64 x 64"},
           {array("m[1:]"), "has 19 maps, but records.csv lists 20 records with a map"},
           {array("n.asfortranarray(m)"), "expected C order"},
           {"os.remove('maps.npy'); os.remove('camera.json')", "contains neither maps.npy"},
           {"t = open('records.csv').read(); open('records.csv', 'w').write(t.replace('\\n7,', "
            "'\\n77,'))",
            "contains a map of record 77; fresh has no such record"},
           {camera("del c['fx']"), unscaled},
           {camera("c['depth_scale'] = 0"), unscaled},
           {camera("c = [1]"), unscaled},
           {camera("c['fx'] *= 1.05"), "for the field of view of the run"},
           {camera("c['width'] = 32"), "maps have 32 x 64 pixels; expected 64 x 64"},
           {camera("c['width'] = 1e300"), "maps have 1000000 x 64 pixels; expected 64 x 64"},
           {camera("open('000007_mm.png', 'wb').write(b'no picture')"),
            "000007_mm.png: expected a 16-bit grey PNG of 64 x 64"}}) {
    std::filesystem::remove_all(dir / "bad");
    std::filesystem::copy(dir / "o", dir / "bad");
    numpy(dir, "import os; os.chdir('bad'); m = n.load('maps.npy'); " + change);
    CAPTURE(change);
    dir.refuses("evaluate --maps bad fresh", 1, words);
  }
}

TEST_CASE("reconstruct --rows processes only the listed or the held-out records") {
  const ReconFolder dir;
  const std::string trained_on = made_run(120), model = made_model("ridge", 120, 1, {});
  a_run(4, 2).write(dir / "fresh");
  const std::string reconstruct = "reconstruct -q --format npy,foreground " + model + " ",
                    ours = reconstruct + trained_on + " --out ";
  for (const char* rows : {"all", "few --rows 7,3", "test --rows test"}) dir.done(ours + rows);
  const std::string names = "a = lambda f, k: n.load(f + '/' + k + '.npy'); ";
  CHECK(numpy(dir, names +
                       "print([n.array_equal(a('all', k)[[3, 7]], a('few', k), equal_nan=True) for "
                       "k in ('maps', 'thresholded', 'share')])") == "[True, True, True]\n");
  CHECK(numpy(dir,
              names +
                  "s = a('all', 'share') > .5; m = a('all', 'maps'); t = a('all', 'thresholded'); "
                  "print(s.any(), n.array_equal(t[s], m[s]), n.isnan(t[~s]).all())") ==
        "True True True\n");
  const std::string csv = contents(dir / "few/records.csv"),
                    held_out = contents(dir / "test/records.csv");
  CHECK(std::count(csv.begin(), csv.end(), '\n') == 3);
  CHECK_THAT(csv, Contains("\n3,\"ok\",") && Contains("\n7,\"ok\","));
  CHECK(dir.json("evaluate " + model + " " + trained_on)["records"] ==
        std::count(held_out.begin(), held_out.end(), '\n') - 1);
  dir.refuses(ours + "no --rows 3,x", 2,
              "--rows: \"x\": expected record indices, e.g. 3,7, or test");
  dir.refuses(ours + "no --rows 3,900", 1, "--rows: the run has no record 900");
  dir.refuses(ours + "no --rows 3 --follow", 2, "--rows cannot be combined with --follow");
  dir.refuses(reconstruct + "fresh --out none --rows test", 1,
              "the model was not trained on this run");
}

TEST_CASE("the written point cloud, array and picture contain the same depth map") {
  const ReconFolder dir;
  const std::string model = made_model("mlp-48-24", 240, 1, {"--epochs", "90"});
  a_run(3, 2).write(dir / "live");
  dir.done("reconstruct -q --format mm,ply,npy " + model + " live --out o");
  CHECK_FALSE(std::filesystem::exists(dir / "o/000000.png"));
  const auto mm = picture(dir / "o/000002_mm.png");
  REQUIRE(mm.size() == 4096);
  const auto points = points_of(contents(dir / "o/000002.ply"));
  // The plate covers about 240 pixels, each with three coordinates.
  REQUIRE(points.size() > 3 * 50);
  REQUIRE(points.size() < 3 * 800);
  // Uses the pinhole camera model of OpenCV and Open3D to project each point into the depth image.
  const auto pinhole = nlohmann::json::parse(contents(dir / "o/camera.json"));
  const double fx = pinhole["fx"], fy = pinhole["fy"], cx = pinhole["cx"], cy = pinhole["cy"];
  std::size_t strangers = 0;
  for (std::size_t i = 0; i < points.size(); i += 3) {
    const double x = double{points[i]}, y = double{points[i + 1]}, z = double{points[i + 2]};
    const auto column = std::lround(cx + fx * x / z), row = std::lround(cy + fy * y / z);
    REQUIRE((column >= 0 && column < 64 && row >= 0 && row < 64));
    const double seen = mm[static_cast<std::size_t>(row * 64 + column)] * 1e-3;
    strangers += std::hypot((static_cast<double>(column) - cx) / fx * seen - x,
                            (static_cast<double>(row) - cy) / fy * seen - y, seen - z) > 1e-3;
  }
  CHECK(strangers == 0);
  CHECK_THAT(contents(dir / "o/camera.json"),
             Contains("\"width\": 64, \"height\": 64, \"fx\": 58.18181") &&
                 Contains("\"cx\": 31.5, \"cy\": 31.5") && EndsWith("31.5, 31.5, 1]}\n"));
  const std::string peak = std::to_string(std::ranges::max(mm));
  CHECK(
      numpy(dir, "a = n.load('o/maps.npy'); print(a.shape, round(float(n.nanmax(a[2])) * 1000))") ==
      "(3, 64, 64) " + peak + "\n");
}

TEST_CASE("reconstruct writes body positions to records.csv and summarises repeated messages") {
  const ReconFolder dir;
  const std::string model = made_model("mean-shape", 120);
  a_run(16, 2, [](FusedRecord& r) {
    Rng rng = make_rng(2, static_cast<std::uint64_t>(r.index));
    if (r.index == 0) r = plate_record(0, 0.5, 3.5, rng);
    if (r.index >= 4) std::ranges::fill(counts(r), 0u);
  }).write(dir / "fresh");
  CHECK_THAT(dir.done("reconstruct " + model + " fresh --out o", 5),
             Contains("12 records between 4 and 15: spd is the same in every bin\n") &&
                 !Contains("record 4:"));
  double x_m = 0, z_m = 0;
  const std::string table = contents(dir / "o/records.csv");
  const auto first = table.find("\n0,\"ok\",,");
  REQUIRE(first != std::string::npos);
  REQUIRE(std::sscanf(table.c_str() + first, "\n0,\"ok\",,%lf,%lf,", &x_m, &z_m) == 2);
  CHECK(x_m == Approx(0.5).margin(0.1));
  CHECK(z_m == Approx(3.5).margin(0.2));
}

TEST_CASE("reconstruct --follow processes a live run until it is closed") {
  const ReconFolder dir;
  const std::string out = dir / "o";
  const auto run = a_run(0).without_axis(Sensor::radar).open(dir / "live");
  Rng rng = make_rng(4, 4);
  const auto record = [&](std::int64_t index) {
    record::FusedRecord r = plate_record(index, 0.3, 3.5, rng);
    r.slot_end = system_clock.now();
    return r;
  };
  // When record 0 is written, the run contains neither radar data nor a radar axis.
  auto first = record(0);
  lose(first, Sensor::radar);
  run->append(first);
  const pid_t child = start_recon({"reconstruct", made_model("ridge", 60), dir / "live", "--out",
                                   out, "--follow", "--format", "mm,npy"},
                                  dir / "log");
  wait_for("record 0",
           [&] { return contents(out + "/records.csv").find("\n0,") != std::string::npos; });
  run->put_axis(radar_axis());
  for (std::int64_t i = 1; i <= 3; ++i) {
    run->append(record(i));
    const std::string name = out + "/00000" + std::to_string(i) + "_mm.png";
    wait_for(name, [&] { return std::filesystem::exists(name); });
  }
  CHECK(waitpid(child, nullptr, WNOHANG) == 0);
  run->close("complete");
  // Exit code 5 means that at least one record was excluded, which in this test is record 0.
  CHECK(exit_code(child) == 5);
  CHECK_THAT(contents(dir / "log"),
             Contains("record 0: lacks radar, which the model needs") &&
                 Contains("record 3: map ready 0.") &&
                 Contains("3 records reconstructed, 1 left out; maps ready 0."));
  CHECK(numpy(dir, "print(n.load('o/maps.npy').shape)") == "(3, 64, 64)\n");
}

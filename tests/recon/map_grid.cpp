// SPDX-License-Identifier: MIT
// Tests map grids of any size, from the axes of a run to the predicted maps.
#include <nlohmann/json.hpp>

#include "recon/maps/png.hpp"
#include "recon/predict/trained_model.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::test;

namespace {

void write_mapped(const std::string& path, std::int64_t count, const record::MapGrid& grid,
                  std::uint64_t seed = 1) {
  a_run(count, seed).map(grid).write(path);
}

}  // namespace

TEST_CASE("depth images are resampled to the map grid of the run") {
  const Folder dir;
  write_mapped(dir / "run", 3, {32, 0.275});
  const Dataset data = load({dir / "run"});
  CHECK(data.map == record::MapGrid{32, 0.275});
  REQUIRE(depth_maps(data).cols == 32 * 32);
  // The map covers the central half of the camera's field of view, which is 32 x 32 of the 64 x 64
  // camera pixels.
  const auto r = record::RunReader(dir / "run").read(1);
  for (std::size_t row = 0; row < 32; ++row)
    for (std::size_t c = 0; c < 32; ++c)
      REQUIRE(depth_maps(data).row(1)[row * 32 + c] ==
              Approx(depth_mm(r)[(row + 16) * 64 + c + 16] * 1e-3));
}

TEST_CASE("loading refuses runs with different map grids and runs with invalid map axes") {
  const Folder dir;
  a_run(2).write(dir / "a");
  write_mapped(dir / "b", 2, {32, 0.55}, 2);
  CHECK(error_of([&] {
          load({dir / "a", dir / "b"});
        }) == dir / "b" + ": depth maps have 32 x 32 pixels, |x/z| up to 0.55, depth up to 6 m; " +
                  dir / "a" + " has 64 x 64 pixels, |x/z| up to 0.55, depth up to 6 m");
  write_mapped(dir / "same", 2, {}, 3);
  CHECK(load({dir / "a", dir / "same"}).size() == 4);
  const auto refused = [&](const std::string& change, const std::vector<Value>& values) {
    damaged(dir / "same", dir / "bad", change, values);
    CHECK_THAT(error_of([&] { load({dir / "bad"}); }),
               Catch::Contains("bad: axes map_x, map_y and map_z: expected 3 to 256 pixels"));
  };
  refused("map axes have ?1 points", {8});
  refused("axis ?1 has the step ?2", {"map_z", 70});
  refused("map axes have ?1 points", {300});
  refused("without axis ?1", {"map_y"});
  refused("axis ?1 has the step ?2", {"map_y", record::MapGrid{}.step()});
  refused("axis ?1 starts at ?2", {"map_x", 0});
}

TEST_CASE(
    "a model keeps the map grid of its training runs, and evaluate refuses runs with other grids") {
  const Folder dir;
  const record::MapGrid grid{24, 0.55};
  write_mapped(dir / "run", 200, grid);
  a_run(8, 2).write(dir / "other");
  const std::string out = " --out " + (dir / "maps") + " --format mm,npy,ply,uncertainty --force ";
  for (const std::string kind : {"ridge", "factorised-4"}) {
    CAPTURE(kind);
    const std::string m = dir / kind;
    REQUIRE(recon_program("train -q --epochs 3 --set validation_share=0.2 --model " + kind + " " +
                          (dir / "run") + " --out " + m)
                .code == 0);
    const TrainedModel model = load_model(m);
    CHECK(model.first().scene.grid == grid);
    const Dataset data = load({dir / "run"});
    CHECK(model.predict(data, {0, 1}).cols == 24 * 24);
    const auto json =
        nlohmann::json::parse(recon_program("evaluate -q --json " + m + " " + (dir / "run")).text);
    CHECK(json["metrics"]["iou"]["mean"].get<double>() > 0.2);
    const Outcome assessed = recon_program("evaluate " + m + " " + (dir / "other"));
    CHECK(assessed.code == 1);
    CHECK_THAT(assessed.text,
               Catch::Contains("depth maps have 64 x 64 pixels, |x/z| up to 0.55, depth up to 6 m; "
                               "the model has 24 x 24 pixels, |x/z| up to 0.55, depth up to 6 m"));
    const Outcome drawn = recon_program("reconstruct -q " + m + " " + (dir / "other") + out);
    CAPTURE(drawn.text);
    CHECK(drawn.code == 0);
    const std::string png = contents(dir / "maps/000003_mm.png");
    CHECK(recon::decode_png16(Bytes(png.begin(), png.end()), 24, 24).size() == 24 * 24);
  }
}

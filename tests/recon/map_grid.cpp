// SPDX-License-Identifier: MIT
// Tests map grids of any size, from the axes of a run to the predicted maps.

#include "recon/predict/trained_model.hpp"
#include "world.hpp"

TEST_CASE("depth images are resampled to the map grid of the run") {
  const Folder dir;
  const Dataset data = load({a_run(3).map({32, 0.275}).write(dir / "run")});
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
  a_run(2, 2).map({32, 0.55}).write(dir / "b");
  CHECK_THAT(error_of([&] {
               load({dir / "a", dir / "b"});
             }),
             Contains("b: depth maps have 32 x 32 pixels, |x/z| up to 0.55, depth up to 6 m; ") &&
                 EndsWith("a has 64 x 64 pixels, |x/z| up to 0.55, depth up to 6 m"));
  a_run(2, 3).map({}).write(dir / "same");
  CHECK(load({dir / "a", dir / "same"}).size() == 4);
  const std::vector<std::pair<const char*, std::vector<Value>>> changes = {
      {"map axes have ?1 points", {8}},
      {"axis ?1 has the step ?2", {"map_z", 70}},
      {"map axes have ?1 points", {300}},
      {"without axis ?1", {"map_y"}},
      {"axis ?1 has the step ?2", {"map_y", record::MapGrid{}.step()}},
      {"axis ?1 starts at ?2", {"map_x", 0}}};
  for (const auto& [change, values] : changes)
    CHECK_THAT(error_of([&] { load({damaged(dir / "same", dir / "bad", change, values)}); }),
               Contains("bad: axes map_x, map_y and map_z: expected 3 to 256 pixels"));
}

TEST_CASE("a model keeps the map grid of its training runs, and evaluate refuses other grids") {
  const ReconFolder dir;
  const record::MapGrid grid{24, 0.55};
  a_run(200).map(grid).write(dir / "run");
  a_run(8, 2).write(dir / "other");
  const std::string out = " --out maps --format mm,npy,ply,uncertainty --force ";
  for (const std::string kind : {"ridge", "factorised-4"}) {
    CAPTURE(kind);
    dir.done("train -q --epochs 3 --set validation_share=0.2 --model " + kind + " run --out " +
             kind);
    const TrainedModel model = load_model(dir / kind);
    CHECK(model.first().scene.grid == grid);
    CHECK(model.predict(load({dir / "run"}), {0, 1}).cols == 24 * 24);
    CHECK(dir.json("evaluate " + kind + " run")["metrics"]["iou"]["mean"] > 0.2);
    CHECK_THAT(dir.done("evaluate " + kind + " other", 1),
               Contains("depth maps have 64 x 64 pixels, |x/z| up to 0.55, depth up to 6 m; "
                        "the model has 24 x 24 pixels, |x/z| up to 0.55, depth up to 6 m"));
    dir.done("reconstruct -q " + kind + " other" + out);
    CHECK(picture(dir / "maps/000003_mm.png", 24).size() == 24 * 24);
  }
}

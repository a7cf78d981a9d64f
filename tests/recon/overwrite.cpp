// SPDX-License-Identifier: MIT
// Tests that existing files are kept unless the user allows overwriting, that FIFOs are refused,
// and that symbolic links are not followed.
#include <sys/stat.h>

#include "../fixtures/full_disk.hpp"
#include "recon/predict/trained_model.hpp"
#include "world.hpp"

TEST_CASE("train never overwrites an existing file") {
  const ReconFolder dir;
  a_run(40).write(dir / "run");
  const std::string train = "train -q --set fallback=false --model ridge run --out ";
  dir.done(train + "m");
  for (const std::string name : {"m", "run"}) {
    const std::string before = contents(dir / name);
    dir.refuses(train + name + " --seed 2", 2,
                name + ": the file exists; choose another --out, or remove the file");
    CHECK(contents(dir / name) == before);
  }
}

TEST_CASE("a model file created by another process during training is kept") {
  const Folder dir;
  const TrainedModel model = load_model(made_model("ridge", 60));
  std::ofstream(dir / "m") << "precious";
  CHECK_THROWS_WITH(save_model(model, dir / "m"),
                    Contains("another process created this file") && Contains(dir / "m.part"));
  CHECK(contents(dir / "m") == "precious");
  CHECK(load_model(dir / "m.part").first().name == "ridge");
}

TEST_CASE("reconstruct overwrites the maps of another run only with --force") {
  const ReconFolder dir;
  a_run(3).write(dir / "run"), a_run(3, 2).write(dir / "other");
  const auto maps = [&](const std::string& run) {
    return "reconstruct -q " + made_model("ridge", 60) + " --format mm --out maps " + run;
  };
  dir.done(maps("run"));
  const std::string first = contents(dir / "maps/000000_mm.png");
  CHECK_THAT(contents(dir / "maps/run.txt"), Contains("run"));
  dir.refuses(maps("other"), 2, "maps: contains maps of another run, run");
  CHECK(contents(dir / "maps/000000_mm.png") == first);
  // Overwriting the maps of the same run is allowed.
  dir.done(maps("run"));
  dir.done(maps("other --force"));
  CHECK(contents(dir / "maps/000000_mm.png") != first);
  std::filesystem::remove(dir / "maps/run.txt");
  dir.refuses(maps("run"), 2, "maps: contains maps of another run, an unknown run");
}

TEST_CASE("a FIFO given as a model is refused without blocking") {
  const ReconFolder dir;
  REQUIRE(::mkfifo((dir / "f").c_str(), 0666) == 0);
  for (const std::string command : {"evaluate f ", "reconstruct -q --out o f "})
    dir.refuses(command + made_run(60), 1, "f: is a FIFO; expected a regular file");
}

TEST_CASE("reconstruct leaves no partial picture on a full disk and follows no symbolic links") {
  const ReconFolder dir;
  const std::string command =
      "reconstruct -q " + made_model("ridge", 60) + " " + made_run(60) + " --out maps";
  std::filesystem::create_directory(dir / "maps");
  std::ofstream(dir / "victim") << "precious";
  for (const char* name : {"000000.png", "000000_mm.png", "records.csv", "run.txt"})
    std::filesystem::create_symlink(dir / "victim", dir / (std::string("maps/") + name));
  const auto left = [&] {
    return std::ranges::count_if(std::filesystem::directory_iterator(dir / "maps"),
                                 [](const auto& entry) { return !entry.is_symlink(); });
  };
  {
    // The limit leaves enough space for the table's header, but not for an image.
    const FullDisk disk(400);
    CHECK_THAT(dir.done(command + " --force", 6),
               Contains("000000.png: cannot be written: File too large"));
  }
  CHECK(contents(dir / "victim") == "precious");
  // The files left in the folder are records.csv, run.txt and camera.json.
  CHECK(left() == 3);
  dir.done(command);
  CHECK(contents(dir / "victim") == "precious");
  CHECK(left() == 3 + 2 * 60);
}

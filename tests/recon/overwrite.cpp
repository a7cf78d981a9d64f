// SPDX-License-Identifier: MIT
// Tests that existing files are kept unless the user allows overwriting, that FIFOs are refused,
// and that symbolic links are not followed.
#include <sys/stat.h>

#include "../fixtures/full_disk.hpp"
#include "recon/predict/trained_model.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::test;

namespace {

void refuses(const std::string& arguments, const std::string& saying, int code = 2) {
  CAPTURE(arguments);
  const Outcome o = recon_program(arguments);
  CHECK(o.code == code);
  CHECK_THAT(o.text, Catch::Contains(saying));
  CHECK(std::count(o.text.begin(), o.text.end(), '\n') == 1);
}

std::string trained(const Folder& dir, const std::string& model, const std::string& options = "") {
  return "train -q --set fallback=false --model ridge " + (dir / "run") + " --out " +
         (dir / model) + options;
}

}  // namespace

TEST_CASE("train never overwrites an existing file") {
  const Folder dir;
  a_run(40).write(dir / "run");
  REQUIRE(recon_program(trained(dir, "m")).code == 0);
  for (const std::string name : {"m", "run"}) {
    const std::string before = contents(dir / name);
    refuses(trained(dir, name, " --seed 2"),
            name + ": the file exists; choose another --out, or remove the file");
    CHECK(contents(dir / name) == before);
  }
}

TEST_CASE("a model file created by another process during training is kept") {
  const Folder dir;
  a_run(40).write(dir / "run");
  REQUIRE(recon_program(trained(dir, "a")).code == 0);
  REQUIRE(recon_program(trained(dir, "m")).code == 0);
  const std::string before = contents(dir / "m");
  const TrainedModel model = load_model(dir / "a");
  CHECK_THROWS_WITH(
      save_model(model, dir / "m"),
      Catch::Contains("another process created this file") && Catch::Contains(dir / "m.part"));
  CHECK(contents(dir / "m") == before);
  CHECK(load_model(dir / "m.part").first().name == "ridge");
}

TEST_CASE("reconstruct overwrites the maps of another run only with --force") {
  const Folder dir;
  a_run(40).write(dir / "run");
  a_run(3, 2).write(dir / "other");
  REQUIRE(recon_program(trained(dir, "m")).code == 0);
  const auto maps = [&](const std::string& run, const std::string& options = "") {
    return "reconstruct -q " + (dir / "m") + " " + (dir / run) + " --format mm --out " +
           (dir / "maps") + options;
  };
  REQUIRE(recon_program(maps("run")).code == 0);
  const std::string first = contents(dir / "maps/000000_mm.png");
  CHECK_THAT(contents(dir / "maps/run.txt"), Catch::Contains(dir / "run"));
  refuses(maps("other"), "maps: contains maps of another run, " + (dir / "run"));
  CHECK(contents(dir / "maps/000000_mm.png") == first);
  // Overwriting the maps of the same run is allowed.
  CHECK(recon_program(maps("run")).code == 0);
  CHECK(recon_program(maps("other", " --force")).code == 0);
  CHECK(contents(dir / "maps/000000_mm.png") != first);
  std::filesystem::remove(dir / "maps/run.txt");
  refuses(maps("run"), "maps: contains maps of another run, an unknown run");
}

TEST_CASE("a FIFO given as a run or a model is refused without blocking") {
  const Folder dir;
  const std::string run = made_run(60);
  const std::string model = made_model("ridge", 60);
  REQUIRE(::mkfifo((dir / "f").c_str(), 0666) == 0);
  for (const std::string& command :
       {"evaluate " + model + " " + (dir / "f"), "evaluate " + (dir / "f") + " " + run,
        "reconstruct -q " + model + " " + (dir / "f") + " --out " + (dir / "o"),
        "reconstruct -q " + (dir / "f") + " " + run + " --out " + (dir / "o"),
        "train -q " + (dir / "f") + " --out " + (dir / "n")})
    refuses(command, "f: is a FIFO; expected a regular file", 1);
}

TEST_CASE("reconstruct leaves no partial picture on a full disk and follows no symbolic links") {
  const Folder dir;
  const std::string run = made_run(60);
  const std::string model = made_model("ridge", 60);
  const std::string command = "reconstruct -q " + model + " " + run + " --out " + (dir / "maps");
  std::filesystem::create_directory(dir / "maps");
  std::ofstream(dir / "victim") << "precious";
  for (const char* name : {"000000.png", "000000_mm.png", "records.csv", "run.txt"})
    std::filesystem::create_symlink(dir / "victim", dir / (std::string("maps/") + name));
  const auto left = [&] {
    std::size_t files = 0;
    for (const auto& entry : std::filesystem::directory_iterator(dir / "maps"))
      files += entry.is_symlink() ? 0 : 1;
    return files;
  };
  {
    // The limit leaves enough space for the table's header, but not for an image.
    const FullDisk disk(400);
    const Outcome o = recon_program(command + " --force");
    CAPTURE(o.text);
    CHECK(o.code == 6);
    CHECK_THAT(o.text, Catch::Contains("000000.png: cannot be written: File too large"));
  }
  CHECK(contents(dir / "victim") == "precious");
  // The files left in the folder are records.csv, run.txt and camera.json.
  CHECK(left() == 3);
  const Outcome o = recon_program(command);
  CAPTURE(o.text);
  CHECK(o.code == 0);
  CHECK(contents(dir / "victim") == "precious");
  CHECK(left() == 3 + 2 * 60);
}

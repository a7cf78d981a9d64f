// SPDX-License-Identifier: MIT
// Work in parts: each command with --part in turn, and then without, does what it does at once.
#include <fstream>
#include <sstream>

#include "recon/use/trained_model.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;
using Catch::Contains;

namespace {

// The command as parts 1/N to N/N, in any order.
void in_parts(const std::string& command, int parts) {
  for (int k = parts; k > 0; --k) {
    const Outcome o =
        recon_program(command + " --part " + std::to_string(k) + "/" + std::to_string(parts));
    CAPTURE(o.text);
    REQUIRE(o.code == 0);
  }
}

std::vector<std::string> rows_of(const std::string& path) {
  std::istringstream in(contents(path));
  std::vector<std::string> out;
  for (std::string line; std::getline(in, line);)
    if (!line.starts_with("# ") && !line.starts_with("axis,")) out.push_back(line);
  return out;
}

void simulate(const std::string& words) {
  REQUIRE(std::system((echofuse::test::bin_dir + "/echofuse-sim dataset -q " + words).c_str()) ==
          0);
}

// All that tells two trainings apart: maps of a run bit for bit, losses, and what was seen.
std::string model_text(const std::string& path, const std::string& run) {
  const TrainedModel model = load_model(path);
  const Dataset data = load({run});
  std::ostringstream out;
  out << std::hexfloat;
  for (const float metres : model.predict(data, all_rows(data.size())).values) out << metres << ' ';
  for (const double loss : model->log.loss) out << loss << ' ';
  for (const auto index : model.seen.index) out << index << ' ';
  for (const auto part : model.seen.part) out << int{part} << ' ';
  out << model.data_hash << ' ' << model->name;
  return out.str();
}

}  // namespace

TEST_CASE("a training on the parts of a data set, in any order, is that on the whole one") {
  const Folder dir;
  std::string parts;
  for (const char* k : {"3", "1", "10", "2", "4", "5", "6", "7", "8", "9"}) {
    const std::string part = dir / (std::string("part-") + k + ".sqlite");
    simulate("--records 120 --part " + std::string(k) + "/10 --out " + part);
    parts += " " + part;
  }
  simulate("--records 120 --out " + (dir / "whole.sqlite"));
  const std::string train = "train -q --model mlp --set hidden=8 --epochs 2 ";
  REQUIRE(recon_program(train + parts + " --out " + (dir / "a.h5")).code == 0);
  REQUIRE(recon_program(train + (dir / "whole.sqlite") + " --out " + (dir / "b.h5")).code == 0);
  const std::string whole = dir / "whole.sqlite";
  CHECK(model_text(dir / "a.h5", whole) == model_text(dir / "b.h5", whole));
  // A part is known to the model that was trained on all of them.
  const Outcome known = recon_program("evaluate " + (dir / "a.h5") + " " + (dir / "part-3.sqlite"));
  CHECK(known.code == 0);
  const Outcome twice =
      recon_program(train + parts + " " + (dir / "part-3.sqlite") + " --out " + (dir / "c.h5"));
  CHECK(twice.code == 1);
  CHECK_THAT(twice.text, Contains("part-3.sqlite: has records of "));
  sql(dir / "part-4.sqlite",
      "INSERT INTO calibration VALUES ('radar', '2026-01-01T00:00:00Z', 'reflector', 1, 0.05, "
      "0.001)");
  const Outcome moved = recon_program(train + parts + " --out " + (dir / "c.h5"));
  CHECK(moved.code == 1);
  CHECK_THAT(moved.text, Contains(": has another calibration than ") && Contains("part-4.sqlite") &&
                             Contains(", a part of the same data set"));
}

TEST_CASE("study stability in parts is that in one, byte by byte", "[.]") {
  const Folder dir;
  const std::string study =
      "study stability -q --quick --seeds 2 --records 120 --test-records 20 --axes "
      "matched-side,shifted-radar_offset --models nearest,silhouette --out ";
  REQUIRE(recon_program(study + (dir / "whole")).code == 0);
  in_parts(study + (dir / "parts"), 3);
  // No row is measured twice.
  std::size_t sum = 0;
  std::string all;
  for (const char* k : {"1", "2", "3"}) {
    const std::string part = dir / ("parts/stability-part-" + std::string(k) + "-of-3.csv");
    CHECK(!rows_of(part).empty());
    sum += rows_of(part).size();
    all += contents(part);
  }
  CHECK(sum == 2 * (1 + 1 + 3) * 4);
  CHECK_FALSE(std::filesystem::exists(dir / "parts/stability.csv"));
  REQUIRE(recon_program(study + (dir / "parts")).code == 0);
  for (const char* name : {"stability.csv", "stability.html"})
    CHECK(contents(dir / ("parts/" + std::string(name))) ==
          contents(dir / ("whole/" + std::string(name))));
  // Rows that no part has are measured.
  std::filesystem::create_directory(dir / "two");
  for (const char* name : {"/stability-part-1-of-3.csv", "/stability-part-3-of-3.csv"})
    std::filesystem::copy(dir / ("parts" + std::string(name)), dir / ("two" + std::string(name)));
  REQUIRE(recon_program(study + (dir / "two")).code == 0);
  CHECK(contents(dir / "two/stability.csv") == contents(dir / "whole/stability.csv"));
  // One file behind the other is a file of the study.
  std::filesystem::create_directory(dir / "cat");
  std::ofstream(dir / "cat/stability.csv") << all;
  REQUIRE(recon_program(study + (dir / "cat")).code == 0);
  CHECK(contents(dir / "cat/stability.csv") == all);
  CHECK(contents(dir / "cat/stability.html") == contents(dir / "whole/stability.html"));
  // A part that was killed goes on.
  const std::string killed = dir / "two/stability-part-1-of-3.csv", first = contents(killed);
  std::filesystem::remove(dir / "two/stability.csv");
  std::filesystem::resize_file(killed, first.size() - 30);
  REQUIRE(recon_program(study + (dir / "two") + " --part 1/3").code == 0);
  CHECK(contents(killed) == first);
  const Outcome other =
      recon_program(study + (dir / "parts") + " --set radar_snr_db=10 --part 2/3");
  CHECK(other.code == 3);
  CHECK_THAT(other.text, Contains(".csv: was measured with \"# set "));
  CHECK(recon_program(study + (dir / "parts") + " --part 4/3").code == 2);
}

TEST_CASE("study pareto in parts: accuracy from them, times from the run that takes them") {
  const Folder dir;
  write_run(dir / "train", 100);
  write_run(dir / "test", 40, 5);
  const std::string study = "study pareto " + (dir / "train") + " " + (dir / "test") +
                            " -q --models empty,silhouette --photons 0.1 --records 0.5 "
                            "--sweep-models mean --out ";
  REQUIRE(recon_program(study + (dir / "whole")).code == 0);
  in_parts(study + (dir / "parts"), 2);
  for (const char* k : {"1", "2"})
    for (const auto& row : rows_of(dir / ("parts/pareto-part-" + std::string(k) + "-of-2.csv")))
      CHECK_THAT(row, Contains(",fused,-,1,") || Contains(",fused,-,2,"));  // no times, no seed 3
  REQUIRE(recon_program(study + (dir / "parts")).code == 0);
  const auto accuracy = [&](const char* folder) {  // no machine, no times
    std::vector<std::string> rows = rows_of(dir / (std::string(folder) + "/pareto.csv"));
    for (auto& row : rows) {
      for (int times = 0; times < 3; ++times) row.resize(row.rfind(','));
      const auto machine = row.find(",fused,") + 7;
      row.erase(machine, row.find(',', machine) - machine);
    }
    return rows;
  };
  CHECK(accuracy("parts").size() == 3 * 4);
  CHECK(accuracy("parts") == accuracy("whole"));
  const Outcome one = recon_program(study + (dir / "one") + " --seeds 1 --part 1/2");
  CHECK(one.code == 2);
  CHECK_THAT(one.text, Contains("nothing to share"));
}

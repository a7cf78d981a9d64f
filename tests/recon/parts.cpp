// SPDX-License-Identifier: MIT
// Data sets in parts.
#include <sstream>

#include "recon/use/trained_model.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;
using Catch::Contains;

namespace {

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

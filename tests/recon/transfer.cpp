// SPDX-License-Identifier: MIT
// The study of transfer from one simulated world to another.
#include "recon/study/transfer.hpp"

#include <fstream>

#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

TEST_CASE(
    "study transfer: a row a way and number of records, a chart, and again nothing is measured") {
  const Folder dir;
  const std::string study =
      "study transfer -q --quick --seeds 1 --model silhouette --sizes 12 "
      "--records 120 --test-records 20 --out " +
      (dir / "out");
  const Outcome o = recon_program(study);
  CAPTURE(o.text);
  REQUIRE(o.code == 0);
  std::ifstream csv(dir / "out/transfer.csv");
  std::string line;
  std::getline(csv, line);
  CHECK(line ==
        "from,model,records,seeds,iou,iou_spread,lateral_m,lateral_m_spread,ssim_hard,"
        "ssim_hard_spread,within_90,train_s,machine");
  std::vector<std::string> begins;
  while (std::getline(csv, line)) begins.push_back(line.substr(0, line.find(",1,")));
  CHECK(begins == std::vector<std::string>{"base,as it was,0", "twin,as it was,0",
                                           "none,empty room,12", "none,mean map,12",
                                           "none,nearest neighbour,12", "base,pooled,12",
                                           "base,tuned,12", "twin,pooled,12", "twin,tuned,12"});
  CHECK(std::filesystem::file_size(dir / "out/transfer.svg") > 1000);
  CHECK(recon_program(study + " --sim nowhere").text == o.text);
  CHECK(recon_program(study + " --twin other.toml").code == 3);
}

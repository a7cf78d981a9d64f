// SPDX-License-Identifier: MIT
// The published recordings of Turpin et al. through the real program. They are not part of this
// repository: without them the test is skipped (exit code 77).
#define CATCH_CONFIG_RUNNER
#include <catch2/catch.hpp>
#include <cstdlib>
#include <sstream>

#include "../paths.hpp"
#include "world.hpp"

using namespace echofuse::testing;

namespace {

std::string data_folder() {
  const char* set = std::getenv("ECHOFUSE_DATA");
  return (set ? std::string(set) : echofuse::test::source_dir + "/../shared/data") +
         "/turpin-radar";
}

// SSIM and RMSE of a row of the last table: "  mean       SSIM 0.583  RMSE 0.161".
std::pair<double, double> row_of(const std::string& text, const std::string& name) {
  std::istringstream in(text.substr(text.find("\n  " + name + " ")));
  std::string word;
  double ssim = 0, rmse = 0;
  in >> word >> word >> ssim >> word >> rmse;
  return {ssim, rmse};
}

}  // namespace

TEST_CASE("radar only, blocked cross-validation, beside the published reconstruction") {
  const Folder dir;
  REQUIRE(recon_program("import turpin " + data_folder() + " --out " + (dir / "run") +
                        " --published " + (dir / "published"))
              .code == 0);
  const Outcome o =
      recon_program("crossvalidate -q " + (dir / "run") +
                    " --inputs radar --folds 6 --gap 10 --published " + (dir / "published"));
  INFO(o.text);
  REQUIRE(o.code == 0);
  const auto [mean_ssim, mean_rmse] = row_of(o.text, "mean");
  const auto [nearest_ssim, nearest_rmse] = row_of(o.text, "nearest");
  const auto [ridge_ssim, ridge_rmse] = row_of(o.text, "ridge");
  const auto [published_ssim, published_rmse] = row_of(o.text, "published");
  // Independent of us: NumPy and scikit-image say 0.6278 and 0.1192 of the same arrays.
  CHECK(published_ssim == Approx(0.628).margin(0.002));
  CHECK(published_rmse == Approx(0.119).margin(0.002));
  CHECK(nearest_ssim > mean_ssim);
  CHECK(nearest_rmse < mean_rmse);
  CHECK(ridge_ssim > mean_ssim);
  CHECK(ridge_rmse < mean_rmse);
}

int main(int argc, char** argv) {
  if (!std::filesystem::exists(data_folder() + "/histogram.npy")) {
    std::printf("skipped: no recordings in %s\n", data_folder().c_str());
    return 77;
  }
  return Catch::Session().run(argc, argv);
}

// SPDX-License-Identifier: MIT
// Tables beyond the memory's limit: on disk, without a name, with the same numbers.
#include "recon/numbers/table_memory.hpp"

#include <cstdlib>
#include <tuple>

#include "recon/estimator/predict.hpp"
#include "recon/estimator/train.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using echofuse::testing::error_of;
using echofuse::testing::Folder;
using echofuse::testing::write_run;

namespace {

constexpr std::size_t plenty = std::size_t{1} << 40;

// With this folder for files; in the end as before.
struct Limited {
  std::string before = std::getenv("TMPDIR") ? std::getenv("TMPDIR") : "";
  Limited(std::size_t bytes, const std::string& folder) {
    limit_table_memory(bytes);
    ::setenv("TMPDIR", folder.c_str(), 1);
  }
  ~Limited() {
    limit_table_memory(plenty);
    before.empty() ? ::unsetenv("TMPDIR") : ::setenv("TMPDIR", before.c_str(), 1);
  }
};

}  // namespace

TEST_CASE("a table beyond the limit lies in a file that nobody sees, and goes with it") {
  const Folder dir;
  const std::size_t disk = table_bytes_on_disk();
  const Matrix first(500, 1000);
  const Limited limited(0, dir.path);
  const Matrix small(10, 10);
  CHECK(table_bytes_on_disk() == disk);
  {
    Matrix second(500, 1000);
    CHECK(table_bytes_on_disk() == disk + 2'000'000);
    CHECK(std::filesystem::is_empty(dir.path));
    CHECK(second.values == first.values);  // zeros
    second.row(3)[7] = 5;
    second.add_row(std::vector<float>(1000, 2));
    const Matrix copy = second;
    CHECK((copy.row(3)[7] == 5 && copy.row(500)[999] == 2));
  }
  CHECK(table_bytes_on_disk() == disk);
}

TEST_CASE("where no file can be made, the error says which and how large") {
  const Folder dir;
  const Limited limited(0, dir / "none");
  CHECK_THAT(
      error_of([] { Matrix(500, 1000); }),
      Catch::StartsWith(dir / "none/echofuse-") && Catch::Contains("no room for a table of 1 MiB"));
}

TEST_CASE("a training without memory for its tables ends in the same bits") {
  const Folder dir;
  write_run(dir / "run", 150);
  for (const std::string name : {"mlp", "factorised"}) {
    CAPTURE(name);
    const auto trained = [&](std::size_t bytes) {
      const Limited limited(bytes, dir.path);
      const Dataset data = load({dir / "run"});
      CHECK((table_bytes_on_disk() > 0) == (bytes == 0));
      TrainOptions options;
      options.model = name;
      options.fit.epochs = 3, options.fit.quiet = true;
      const TrainedModel model = train(data, options);
      const Prediction all = predict(model, data, all_rows(data.size()), PredictionDetail::pixels);
      return std::tuple(model.log.loss, model.log.validation_loss, all.maps.values,
                        all.deviation.values);
    };
    CHECK(trained(0) == trained(plenty));
  }
}

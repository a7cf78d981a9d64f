// SPDX-License-Identifier: MIT

#include "../fixtures/folder.hpp"
#include "../fixtures/run.hpp"

using namespace echofuse::record;
using namespace echofuse::test;

namespace {

const Axis three_bins{"spd", "counts", "ps", 3, 0, 100, 1};
const Zones three{{-0.2, 0.1, 0.2, 1100}, {0, 0.1, 0.2, 1150.5}, {}};

void write(const std::string& path, const Zones& zones, std::size_t values) {
  a_small_run(1)
      .only_axes({three_bins})
      .zones(zones)
      .each([=](FusedRecord& r) {
        lose(r, Sensor::radar), lose(r, Sensor::depth);
        counts(r).assign(values, 0);
        std::iota(counts(r).begin(), counts(r).end(), 0u);
      })
      .write(path);
}

}  // namespace

TEST_CASE("detector zones are read back as written, and an unknown direction stays unknown") {
  const Folder folder;
  write(folder / "a", three, 9);
  const RunReader run(folder / "a");
  const Zones zones = run.axis("spd")->zones;
  CHECK(zones == three);
  CHECK_FALSE(zones[2].has_direction());
  CHECK(counts(run.read(0)) == std::vector<std::uint32_t>{0, 1, 2, 3, 4, 5, 6, 7, 8});
}

TEST_CASE("the detector of a run without a zone table has one zone") {
  const Folder folder;
  write(folder / "a", single_pixel(), 3);
  const RunReader run(folder / "a");
  CHECK(run.axis("spd")->zones == single_pixel());
  CHECK(counts(run.read(0)).size() == 3);
}

TEST_CASE("a zone is refused if its width is zero or its time-zero offset exceeds one second") {
  CHECK(Zone{}.plausible());
  CHECK(Zone{0, 0, 0.1, -50}.plausible());
  CHECK_FALSE(Zone{0, 0, 0, 0}.plausible());
  CHECK_FALSE(Zone{0, 101, 0.1, 0}.plausible());
  CHECK_FALSE(Zone{0, 0, 0.1, 2e12}.plausible());
}

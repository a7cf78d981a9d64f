// SPDX-License-Identifier: MIT
#include "../catch.hpp"
#include "../fixtures/folder.hpp"
#include "acquire/record/run_file.hpp"

using namespace echofuse;
using namespace echofuse::record;
using Catch::Contains;
using test::Folder;

namespace {

const Axis spd_axis{"spd", "counts", "ps", 3, 0, 100, 1};
const Zones three{{-0.2, 0.1, 0.2, 1100}, {0, 0.1, 0.2, 1150.5}, {}};

FusedRecord record_of(std::size_t counts) {
  FusedRecord r;
  r.slot_end = HostTime(1'000'000'000);
  r.valid.insert(Sensor::spd);
  for (std::size_t i = 0; i < counts; ++i) r.spd.push_back(static_cast<std::uint32_t>(i));
  return r;
}

void write(const std::string& path, const Zones& zones, std::size_t counts) {
  RunWriter run(path, {});
  run.put_axis(spd_axis);
  run.put_zones(zones);
  run.append(record_of(counts));
  run.close("complete");
}

}  // namespace

TEST_CASE("detector zones are read back as written, and an unknown direction stays unknown") {
  const Folder folder;
  write(folder / "a", three, 9);
  const RunReader run(folder / "a");
  CHECK(run.zones() == three);
  CHECK_FALSE(run.zones()[2].has_direction());
  CHECK(run.read(0).spd == record_of(9).spd);
}

TEST_CASE("a run of a single-pixel detector has no zone table") {
  const Folder folder;
  write(folder / "a", {}, 3);
  const RunReader run(folder / "a");
  CHECK(run.zones().empty());
  CHECK(run.read(0).spd.size() == 3);
  CHECK(histograms_of(run.zones()) == 1);
}

TEST_CASE("a histogram that does not match the number of zones is refused") {
  const Folder folder;
  CHECK_THROWS_WITH(write(folder / "a", three, 6),
                    Contains("spd has 6 values, but its axis has 9"));
}

TEST_CASE("a zone is refused if its width is zero or its time-zero offset exceeds one second") {
  CHECK(Zone{}.plausible());
  CHECK(Zone{0, 0, 0.1, -50}.plausible());
  CHECK_FALSE(Zone{0, 0, 0, 0}.plausible());
  CHECK_FALSE(Zone{0, 101, 0.1, 0}.plausible());
  CHECK_FALSE(Zone{0, 0, 0.1, 2e12}.plausible());
}

// SPDX-License-Identifier: MIT
// Tests the frame parser and the import with recordings that other people made of real radars.

#include "../fixtures/data.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/record.hpp"
#include "acquire/import/import.hpp"
#include "acquire/record/run_reader.hpp"
#include "parsed_frames.hpp"

using namespace echofuse::test;

namespace {

// Recording of an IWR6843 that runs the out-of-box demo of SDK 3.3. The recording is part of TI's
// industrial toolbox 4.7.
const char* const automated_doors = "ti-radar/xwr68xx_oob_automated_doors.dat";

}  // namespace

TEST_CASE(
    "101 frames are parsed from a recording of another TI demo, however the bytes are split") {
  const std::string text = contents(data_folder() / automated_doors);
  const Bytes bytes(text.begin(), text.end());
  REQUIRE(bytes.size() == 79'360);
  const std::size_t piece = GENERATE(1, 63, 4096, 79'360);
  const ParsedFrames p = parse_frames(bytes, [=] { return piece; });
  std::uint32_t number = 209;
  std::string delivered;
  for (const RadarFrame& frame : p.frames) {
    delivered += " " + std::to_string(number++) + "/256/0";
    REQUIRE(frame.lost_before == 0);
    REQUIRE(frame.stats);
  }
  // The frame period is 20 million cycles of a 200 MHz clock (100 ms) with a tolerance of 2 ms.
  for (std::size_t i = 1; i < p.frames.size(); ++i)
    REQUIRE(p.frames[i].time_cpu_cycles - p.frames[i - 1].time_cpu_cycles - 19'600'000 < 800'000);
  CHECK(
      p.line() ==
      "bytes 79360, frames 101, frame_bytes 79360, range_profiles 101, other_tlvs 198, delivered:" +
          delivered);
}

TEST_CASE(
    "each frame of an imported radar recording is assigned to the record that covers its time") {
  const test::Folder folder;
  const std::string config = folder / "lab.toml";
  std::ofstream(config) << "[tdc]\naddress = \"bridge:tcp://127.0.0.1:9\"\n[run]\nwindow_s = 1.0\n";
  acquire::import_recordings(acquire::load_config(config),
                             {.files = {(data_folder() / automated_doors).string()},
                              .cfg = test::source_dir + "/config/radar/xwr68xx_44mm.cfg",
                              .began = "2024-02-07T12:00:00Z",
                              .out = folder / "doors.sqlite"});
  const record::RunReader run(folder / "doors.sqlite");
  REQUIRE(run.count() == 10);
  std::uint64_t frames = 0;
  run.for_each([&](const record::FusedRecord& r) {
    CHECK(r.has(Sensor::radar));
    CHECK(power(r).size() == 256);
    CHECK(r.sync[Sensor::radar].span_s ==
          Approx(r.sync[Sensor::radar].used == 11 ? 1.0 : 0.9).margin(0.01));
    CHECK(r.sync[Sensor::radar].lost == 0);
    frames += r.sync[Sensor::radar].used;
    return true;
  });
  CHECK(frames == 101);
  CHECK(run.info().started_utc == "2024-02-07T12:00:00.000Z");
  // The last slot is closed after its grace period.
  CHECK(run.info().ended_utc == "2024-02-07T12:00:10.500Z");
  // The cfg specifies a frame period of 50 ms, but the recording contains ten frames per second.
  CHECK(std::ranges::any_of(run.events(), [](const record::Event& event) {
    return event.text.starts_with("frame period 100.0 ms; expected 50.0 ms");
  }));
}

int main(int argc, char** argv) {
  return echofuse::test::run_with_data(argc, argv, automated_doors);
}

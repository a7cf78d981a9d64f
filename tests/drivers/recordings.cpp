// SPDX-License-Identifier: MIT
// Tests the frame parser and the import with recordings that other people made of real radars.

#include "../fixtures/data.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/record.hpp"
#include "acquire/import/import.hpp"
#include "acquire/record/run_reader.hpp"
#include "drivers/radar/frame_parser.hpp"

using namespace echofuse::test;

namespace {

Bytes read(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  REQUIRE(file);
  return {std::istreambuf_iterator<char>(file), {}};
}

// Recording of an IWR6843 that runs the out-of-box demo of SDK 3.3. The recording is part of TI's
// industrial toolbox 4.7.
const char* const automated_doors = "ti-radar/xwr68xx_oob_automated_doors.dat";

}  // namespace

TEST_CASE(
    "101 frames are parsed from a recording of another TI demo, however the bytes are split") {
  const Bytes bytes = read(data_folder() / automated_doors);
  REQUIRE(bytes.size() == 79'360);
  for (const std::size_t piece :
       {bytes.size(), std::size_t{1}, std::size_t{63}, std::size_t{4096}}) {
    radar::FrameParser parser(12);
    std::uint32_t number = 209, cycles = 0;
    const auto check = [&](const RadarFrame& frame) {
      REQUIRE(frame.frame_number == number++);
      REQUIRE(frame.power.size() == 256);
      REQUIRE(frame.lost_before == 0);
      REQUIRE(frame.stats);
      // The frame period is 20 million cycles of a 200 MHz clock (100 ms) with a tolerance of 2 ms.
      if (cycles)
        REQUIRE(std::abs(static_cast<int>(frame.time_cpu_cycles - cycles) - 20'000'000) < 400'000);
      cycles = frame.time_cpu_cycles;
    };
    for (std::size_t at = 0; at < bytes.size(); at += piece)
      parser.feed(ByteView(bytes).subspan(at, std::min(piece, bytes.size() - at)), HostTime{},
                  check);
    parser.finish(check);
    const radar::FrameCounts& c = parser.counts();
    CHECK(c.frames == 101);
    CHECK(c.range_profiles == 101);
    CHECK(c.last_frame_number == 309u);
    CHECK(c.frame_bytes == bytes.size());
    CHECK(c.other_tlvs == 198);
    CHECK(c.junk_bytes + c.truncated_frames + c.bad_headers + c.bad_tlvs + c.resyncs +
              c.lost_frames ==
          0);
  }
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

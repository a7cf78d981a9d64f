// SPDX-License-Identifier: MIT
// Tests the import of recordings of a radar's data port.

#include "acquire/config/config.hpp"
#include "acquire/import/frame_times.hpp"
#include "acquire/import/import.hpp"
#include "drivers/core/bytes.hpp"
#include "testing.hpp"

namespace {

acquire::Config config_of(const Folder& folder) {
  write_file(folder / "lab.toml",
             "[tdc]\naddress = \"bridge:tcp://127.0.0.1:9\"\n[run]\nwindow_s = 1\n");
  return acquire::load_config(folder / "lab.toml");
}

// Builds a recording of a radar's data port. The radar clock runs at 200 MHz, and each frame has 64
// bins. The frame period of 49.9 ms keeps the frames away from slot boundaries.
struct RadarFile {
  std::uint32_t header = 40, bins = 64, tlv = 2, length_error = 0, subframe = 0;
  std::uint32_t map_tlv = 0, map_samples = 0;  // heat map
  double period_s = 0.0499;
  Bytes bytes{};

  RadarFile& frame(std::uint32_t number, double at_s) {
    const std::uint32_t map_bytes = map_tlv > 0 ? 8 + 4 * map_samples : 0;
    const std::uint32_t size = (header + 8 + 2 * bins + map_bytes + 31) / 32 * 32;
    const std::size_t begin = bytes.size();
    const auto cycles = static_cast<std::uint32_t>(std::llround(2e8 * at_s));
    for (const int b : {2, 1, 4, 3, 6, 5, 8, 7}) put(bytes, static_cast<std::uint8_t>(b));
    for (const std::uint32_t v :
         {0x03050004u, size, 0xa6843u, number, cycles, 0u, map_tlv > 0 ? 2u : 1u, subframe})
      put(bytes, v);
    bytes.resize(begin + header);
    put(bytes, tlv);
    put(bytes, 2 * bins + length_error);
    for (std::uint32_t i = 0; i < bins; ++i) put(bytes, std::uint16_t{4000});
    if (map_tlv > 0) put(bytes, map_tlv), put(bytes, 4 * map_samples);
    bytes.resize(begin + size, 15);
    return *this;
  }
  RadarFile& frames(std::uint32_t first, std::uint32_t last, double off_s = 0) {
    for (std::uint64_t n = first; n <= last; ++n)
      frame(static_cast<std::uint32_t>(n), off_s + static_cast<double>(n) * period_s);
    return *this;
  }
};

struct RadarImport {
  std::vector<std::uint64_t> used;  // number of frames used in each 1 s record
  std::string said;
  std::vector<std::uint64_t> maps{};  // number of heat maps used in each record
};

const std::string paper_cfg = source_dir + "/config/radar/xwr68xx_paper_50cm.cfg";

RadarImport import_radar(const Bytes& bytes, const std::string& cfg = paper_cfg) {
  const Folder folder;
  write_file(folder / "a.dat", {bytes.begin(), bytes.end()});
  RadarImport out;
  try {
    out.said = acquire::import_recordings(
        config_of(folder), {.files = {folder / "a.dat"}, .cfg = cfg, .out = folder / "a.sqlite"});
  } catch (const Error& e) {
    CHECK(e.code() == ExitCode::failed);
    CHECK_FALSE(fs::exists(folder / "a.sqlite"));
    return {{}, e.what()};
  }
  out.said += warnings_of(folder / "a.sqlite");
  const record::RunReader run(folder / "a.sqlite");
  for (std::int64_t i = 0; i < run.count(); ++i) {
    out.used.push_back(run.read(i).sync[Sensor::radar].used);
    out.maps.push_back(run.read(i).array_frames);
  }
  return out;
}

}  // namespace

TEST_CASE(
    "import takes radar times from the device clock and checks them against the frame numbers") {
  using Used = std::vector<std::uint64_t>;
  const auto check = [](const RadarFile& file, const Used& used, const std::string& saying) {
    const RadarImport i = import_radar(file.bytes);
    CAPTURE(i.said);
    CHECK(i.used == used);
    CHECK(has(i.said, saying));
    if (saying.empty())
      // The only other message reports the start time.
      CHECK(std::ranges::count(i.said, '\n') == 1 + has(i.said, "arrived out of order"));
  };
  constexpr double wrap_s = 0x1p32 * 5e-9;
  const Used even{21, 20, 19};
  check(RadarFile().frames(1, 60), even, "");
  check(RadarFile().frames(1, 60, 20.5), even, "");  // the cycle counter wraps at 21.47 s
  check(RadarFile().frames(0xffffffe0, 0xffffffff, -0x1p32 * 0.0499).frames(0, 27), even, "");
  check(RadarFile().frames(1, 20).frames(31, 60), {20, 11, 19}, "10 frames are missing");
  Used with_gap(37);
  with_gap[0] = 20, with_gap[35] = 2, with_gap[36] = 18;
  check(RadarFile().frames(1, 20).frames(721, 740), with_gap, "700 frames are missing");
  for (const double off_s :
       {std::ldexp(5e-9, 31), std::ldexp(5e-9, 27), std::ldexp(5e-9, 25), -0.2})
    check(RadarFile().frames(1, 19).frame(20, 20 * 0.0499 + off_s).frames(21, 60), even,
          "1 frames have impossible times (frame 20 after 0.90 s): their times");
  check(RadarFile().frames(1, 19).frame(20, 9).frame(21, 3).frames(22, 60), even,
        "2 frames have impossible times");
  check(RadarFile().frames(1, 59).frame(60, 9), even,
        "1 frames have impossible times (frame 60 after 2.89 s)");
  check(RadarFile().frame(1, 10.8).frames(2, 60), even,
        "1 frames have impossible times (frame 1 at the start): their times");
  // Several neighbouring frames have damaged times, at any place.
  for (const auto& [first, last] :
       {std::pair{1u, 2u}, {1u, 5u}, {20u, 24u}, {57u, 60u}, {10u, 45u}})
    for (const bool similar : {true, false}) {
      RadarFile damaged;
      for (std::uint32_t n = 1; n <= 60; ++n)
        damaged.frame(n, n * 0.0499 + (n < first || n > last ? 0 : similar ? 10.74 : 0.37 * n * n));
      if (last - first < 10 || !similar)
        check(damaged, even, std::to_string(last - first + 1) + " frames have impossible times");
    }
  RadarFile half, twice, block, middle, slow, blank, pairs;
  for (std::uint32_t n = 1; n <= 60; ++n) pairs.frame(n, (n - n % 2) * 0.0499);
  check(pairs, even, "the board's clock stands still in 29 frames (frame 3, frame 5");
  for (std::uint32_t n = 1; n <= 60; ++n) half.frame(n, std::min(n, 30u) * 0.0499);
  check(half, even, "the board's clock stands still in 30 frames (frame 31, frame 32");
  for (std::uint32_t n = 1; n <= 60; ++n) middle.frame(n, (n > 20 && n < 40 ? 20 : n) * 0.0499);
  check(middle, even, "the board's clock stands still in 19 frames (frame 21, frame 22");
  for (std::uint32_t n = 1; n <= 60; ++n) blank.frame(0, 0);
  check(blank, {20, 20, 20}, "the frames have neither number nor time: ");
  for (std::uint32_t n = 1; n <= 60; ++n) slow.frame(n, n * 0.25e-6);
  check(slow, {20, 20, 20}, "the board's clock stands still in 59 frames (frame 2, frame 3");
  for (std::uint32_t n = 1; n <= 60; ++n) twice.frames(n, n).frames(n, n);
  check(twice, even, "60 duplicate frames were omitted");
  check(block.frames(1, 40).frames(21, 60), even, "20 duplicate frames were omitted");
  RadarFile still, twos;
  for (std::uint32_t n = 1; n <= 60; ++n) still.frame(n, 0), twos.frames(1 + n % 2, 1 + n % 2);
  check(still, {20, 20, 20}, "the board's clock stands still in 59 frames (frame 2, frame 3");
  check(twos, even, "restarts of the board");
  RadarFile points;
  points.tlv = 1;
  points.frames(1, 59);
  points.tlv = 2;
  check(points.frames(60, 60), {0, 0, 1}, "59 of 60 frames have no range profile");
  // The frame number of frame 20 is corrupted. Of the tested values, only 36 is close enough to 20
  // to look like a gap of 16 lost frames.
  for (const std::uint32_t number : {36u, 1044u, 0x80000014u})
    check(RadarFile().frames(1, 19).frame(number, 20 * 0.0499).frames(21, 60), even,
          "1 frames have impossible numbers (frame " + std::to_string(number) +
              " after 0.90 s): their times");
  // A number at an end of the recording, neighbouring numbers, and exchanged numbers.
  check(RadarFile().frames(1, 59).frame(109, 60 * 0.0499), even, "(frame 109 after 2.89 s)");
  check(RadarFile().frame(33, 0.0499).frames(2, 60), even, "(frame 33 at the start)");
  check(RadarFile().frame(33, 0.0499).frame(34, 0.0998).frames(3, 60), even,
        "2 frames have impossible numbers");
  check(RadarFile().frames(1, 19).frame(21, 20 * 0.0499).frame(20, 21 * 0.0499).frames(22, 60),
        even,
        "2 frames have impossible numbers (frame 21 after 0.90 s, frame 20 after 0.90 s): their");
  // Restarts near the start and with similar clocks.
  check(RadarFile().frames(1, 5).frames(1, 60, 4.1), {21, 20, 20, 4},
        "1 restarts of the board (between frames 5 and 1 at 0.20 s)");
  check(RadarFile().frames(1, 20).frames(1, 25, 0.001), {21, 20, 4},
        "1 restarts of the board (between frames 20 and 1 at 0.95 s)");
  check(RadarFile().frames(1, 20).frames(2, 60, 0.01), {21, 20, 20, 18},
        "1 restarts of the board (between frames 20 and 2 at 0.95 s)");

  check(RadarFile().frames(1, 20).frames(1, 20).frames(1, 20, 7), even,
        "2 restarts of the board (between frames 20 and 1 at 0.95 s, between frames 20 and 1 "
        "at 1.95 s): the gaps have unknown length");
  check(RadarFile().frames(1, 40).frames(41, 60, wrap_s + 1), {21, 19, 1, 19},
        "1 gaps in which the board's clock may have wrapped (between frames 40 and 41 at 1.95 s by "
        "1.05 s + n "
        "x 21.47 s): their lengths are ambiguous");
  const std::string other =
      " ms; expected 50.0 ms from the cfg; check that the recording was made with this cfg";
  check(RadarFile{.period_s = 0.0998}.frames(1, 20), {11, 9}, "frame period 99.8" + other);
  check(RadarFile{.period_s = 0.499}.frames(1, 20), {3, 2, 2, 2, 2, 2, 2, 2, 2, 1},
        "frame period 499.0" + other);
}

TEST_CASE("damaged frame numbers and clock readings do not change the times of other frames") {
  // Up to a third of 300 frames are damaged, in one of four ways.
  const auto seed = static_cast<unsigned>(GENERATE(range(1, 41)));
  const double period_s = GENERATE(0.0333, 0.05, 0.1);
  const std::uint32_t lost = seed % 3 == 0 ? 25 : 0, subframes = seed % 5 == 0 ? 2 : 1;
  CAPTURE(seed, period_s, lost, subframes);
  std::mt19937 engine(seed);
  const auto random = [&] { return static_cast<std::uint32_t>(engine()); };
  std::vector<acquire::FrameHeader> frames;
  std::vector<bool> damaged;
  const std::uint32_t first = random(), cycles = random();
  const auto bit = [&](unsigned lowest) { return 1u << (lowest + random() % (32 - lowest)); };
  for (std::uint32_t i = 0; i < 300; ++i) {
    const std::uint32_t number = i < 150 ? i : i + lost;
    frames.push_back({first + number, (first + number) / subframes,
                      cycles + static_cast<std::uint32_t>(std::llround(number * period_s / 5e-9))});
  }
  damaged.resize(frames.size());
  const std::uint32_t every = seed % 4 == 0 ? 3 : 4 + random() % 20;
  for (std::size_t i = random() % every; i < frames.size(); i += every) {
    damaged[i] = true;
    const unsigned way = seed / 4 % 4;
    if (way == 0) frames[i].position ^= bit(0);
    if (way == 1) frames[i].cycles ^= bit(24);
    if (way == 2) frames[i].cycles += 2'147'483'648u;  // alike in all frames
    if (way == 3) (random() % 2 ? frames[i].position : frames[i].cycles) = random();
  }
  const acquire::FrameTimes fit = acquire::fit_times(frames, subframes, period_s);
  CHECK(std::abs(fit.period_s - period_s) < 1e-6);
  CHECK(fit.restarts.count + fit.paused.count == 0);
  CHECK(std::accumulate(fit.lost.begin(), fit.lost.end(), 0u) == lost / subframes);
  const auto error_s = [&](std::size_t i, std::size_t from) {
    const auto number = [&](std::size_t k) { return k < 150 ? k : k + lost; };
    return std::abs(seconds(fit.at[i] - fit.at[from]) -
                    static_cast<double>(number(i) - number(from)) * period_s);
  };
  const auto start = static_cast<std::size_t>(std::ranges::find(damaged, false) - damaged.begin());
  for (std::size_t i = start; i < frames.size(); ++i) {
    CAPTURE(i);
    if (error_s(i, start) > (damaged[i] ? period_s : 1e-3)) FAIL_CHECK("wrong time");
  }
}

TEST_CASE("subframes may have different periods") {
  const Folder folder;
  std::string cfg = contents(source_dir + "/tests/drivers/four_subframes.cfg");
  cfg.replace(cfg.rfind("1 1 12.5"), 8, "1 1 62.6");
  write_file(folder / "radar.cfg", cfg);
  const double start_s[] = {0, 0.0125, 0.025, 0.0375};
  RadarFile file;
  for (std::uint32_t number = 1; number <= 29; ++number)
    for (file.subframe = 0; file.subframe < 4; ++file.subframe)
      file.frame(number, number * 0.1001 + start_s[file.subframe]);
  const RadarImport i = import_radar(file.bytes, folder / "radar.cfg");
  CAPTURE(i.said);
  CHECK(i.used == std::vector<std::uint64_t>{40, 40, 36});
  CHECK(std::ranges::count(i.said, '\n') == 1);
}

TEST_CASE("import uses only heat maps that match the cfg and the board") {
  const auto frames_of = [](std::uint32_t tlv, std::uint32_t samples, const std::string& saying) {
    const Bytes bytes = RadarFile{.map_tlv = tlv, .map_samples = samples}.frames(1, 60).bytes;
    const auto [used, said, maps] =
        import_radar(bytes, source_dir + "/config/radar/xwr68xx_azimuth_50cm.cfg");
    CAPTURE(said);
    CHECK(has(said, "heat map") == !saying.empty());
    CHECK(has(said, saying));
    return maps.at(1);
  };
  CHECK(frames_of(4, 64 * 8, "") == 20);
  const std::string other = "60 heat maps are unusable: the heat map has ";
  CHECK(frames_of(4, 64 * 12, other + "768 samples in TLV 4, but the cfg") == 0);
  CHECK(frames_of(4, 64 * 4, other + "256 samples in TLV 4, but the cfg") == 0);
  CHECK(frames_of(8, 64 * 8, other + "512 samples in TLV 8, but the cfg") == 0);
  CHECK(frames_of(0, 0, "no frame has a heat map: the fifth number of guiMonitor was 0") == 0);
}

TEST_CASE("import does not mistake lost bytes for converted line ends") {
  const std::size_t losses = GENERATE(1, 3);
  Bytes bytes = RadarFile().frames(1, 60).bytes;
  for (std::size_t i = 0; i < losses; ++i)
    bytes.erase(bytes.begin() + static_cast<std::ptrdiff_t>(100 + 192 * 10 * i));
  const RadarImport i = import_radar(bytes);
  CAPTURE(i.said);
  CHECK(has(i.said, std::to_string(losses) + " frames are damaged"));
  CHECK_FALSE(has(i.said, "line ends"));
}

TEST_CASE("import refuses a radar recording without a range profile and reports the reason") {
  const auto refuses = [](const Bytes& bytes, const std::string& saying) {
    const RadarImport i = import_radar(bytes);
    CHECK(i.used.empty());
    CHECK_THAT(i.said, Catch::Contains("a.dat: nothing to import: ") && Catch::Contains(saying));
    CHECK(std::ranges::count(i.said, '\n') == 0);
  };
  const auto text = [](const std::string& t) { return Bytes(t.begin(), t.end()); };
  refuses({}, "file is empty");
  refuses(text("{\"frame\": 1}\n"), "file contains text; expected the data port's bytes");
  refuses(text("sensorStart\r\nDone\r\nmmwDemo:/>"), "file contains text of the command port");
  const Bytes whole = RadarFile().frames(1, 20).bytes;
  Bytes mangled;
  for (const std::uint8_t b : whole) {
    if (b == '\n') mangled.push_back('\r');
    mangled.push_back(b);
  }
  refuses(mangled, "line ends were converted because the file was saved as text");
  // One byte CR is missing in each frame.
  Bytes shorter = RadarFile().frames(1, 20).bytes;
  for (std::size_t i = 60; i + 1 < shorter.size(); i += 191) {
    shorter[i] = '\n';
    shorter.erase(shorter.begin() + static_cast<std::ptrdiff_t>(i + 1));
  }
  refuses(shorter, "CR LF became LF");
  Bytes seven_bits = whole, utf8;
  for (std::uint8_t& b : seven_bits) b &= 127;
  refuses(seven_bits, "no byte exceeds 127: was the serial port opened with 7 data bits?");
  for (const std::uint8_t b : whole)
    if (b < 128)
      utf8.push_back(b);
    else
      put(utf8, static_cast<std::uint16_t>(0x80c0 | b >> 6 | (b & 63) << 8));
  refuses(utf8, "the bytes were converted to UTF-8 because the file was saved as text");
  refuses(Bytes(5000, 0xf3), "was the file recorded at the data port's baud rate?");
  refuses(RadarFile{.header = 36}.frames(1, 20).bytes, "from SDK 1 or 2.0 (header of 36 bytes)");
  refuses(RadarFile{.header = 48}.frames(1, 20).bytes,
          "not from the out-of-box demo (header of 48 bytes)");
  refuses(RadarFile{.header = 52}.frames(1, 20).bytes,
          "not from the out-of-box demo (header of 52 bytes)");
  refuses(RadarFile{.length_error = 8}.frames(1, 20).bytes,
          "the TLV lengths include the TLV headers");
  refuses(RadarFile{.tlv = 1}.frames(1, 20).bytes,
          "no frame has a range profile: the third number of guiMonitor");
  refuses(
      RadarFile{.bins = 256}.frames(1, 20).bytes,
      "20 frames have 256 bins, but the number of bins in the cfg is 64; check that the recording");
  Bytes part = RadarFile().frames(1, 1).bytes;
  part.resize(100);
  refuses(part, "file contains only part of a frame");
}

// SPDX-License-Identifier: MIT
// Tests the import of recordings of a radar's data port.

#include "acquire/config/config.hpp"
#include "acquire/import/frame_times.hpp"
#include "acquire/import/import.hpp"
#include "drivers/core/bytes.hpp"
#include "testing.hpp"

namespace {

acquire::Config config_of(const Folder& folder) {
  write_file(folder / "lab.toml", "[tdc]\naddress = 'bridge:tcp://h:9'\n[run]\nwindow_s = 1\n");
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
  const std::string path = folder / "a.sqlite";
  RadarImport out;
  const std::string refused = refusal_by(
      [&] {
        out.said = acquire::import_recordings(
            config_of(folder), {.files = {folder / "a.dat"}, .cfg = cfg, .out = path});
      },
      ExitCode::failed);
  CHECK(fs::exists(path) == refused.empty());
  if (!refused.empty()) return {{}, refused};
  out.said += warnings_of(path);
  for (const FusedRecord& r : records_of(path)) {
    out.used.push_back(r.sync[Sensor::radar].used);
    out.maps.push_back(r.array_frames);
  }
  return out;
}

}  // namespace

TEST_CASE("import checks the radar's clock against its frame numbers") {
  using Used = std::vector<std::uint64_t>;
  const Used even{21, 20, 19}, counted{20, 20, 20};
  const auto check = [&](const RadarFile& file, const std::string& saying, const Used& used) {
    const RadarImport i = import_radar(file.bytes);
    CAPTURE(i.said);
    CHECK(i.used == used);
    CHECK(has(i.said, saying));
    if (saying.empty())
      // The only other message reports the start time.
      CHECK(std::ranges::count(i.said, '\n') == 1 + has(i.said, "arrived out of order"));
  };
  // Returns 60 frames. The clock of frame n shows at_s(n).
  const auto timed = [](const auto& at_s) {
    RadarFile out;
    for (std::uint32_t n = 1; n <= 60; ++n) out.frame(n, at_s(n));
    return out;
  };
  // Returns 60 frames. Frame `place` has another number or time.
  const auto with = [](std::uint32_t place, std::uint32_t number, double at_s) {
    return RadarFile().frames(1, place - 1).frame(number, at_s).frames(place + 1, 60);
  };
  constexpr double wrap_s = 0x1p32 * 5e-9, period_s = 0.0499;
  check(RadarFile().frames(1, 60), "", even);
  check(RadarFile().frames(1, 60, 20.5), "", even);  // the cycle counter wraps at 21.47 s
  check(RadarFile().frames(0xffffffe0, 0xffffffff, -0x1p32 * period_s).frames(0, 27), "", even);
  check(RadarFile().frames(1, 20).frames(31, 60), "10 frames are missing", {20, 11, 19});
  Used with_gap(37);
  with_gap[0] = 20, with_gap[35] = 2, with_gap[36] = 18;
  check(RadarFile().frames(1, 20).frames(721, 740), "700 frames are missing", with_gap);
  const std::string times = " frames have impossible times",
                    numbers = "1 frames have impossible numbers (";
  for (const double off_s :
       {std::ldexp(5e-9, 31), std::ldexp(5e-9, 27), std::ldexp(5e-9, 25), -0.2})
    check(with(20, 20, 20 * period_s + off_s),
          "1" + times + " (frame 20 after 0.90 s): their times", even);
  check(with(60, 60, 9), "1" + times + " (frame 60 after 2.89 s)", even);
  check(with(1, 1, 10.8), "1" + times + " (frame 1 at the start): their times", even);
  // Several neighbouring frames have damaged times, at any place.
  for (const auto& [first, last] :
       {std::pair{1u, 2u}, {1u, 5u}, {20u, 24u}, {57u, 60u}, {10u, 45u}})
    for (const bool similar : {true, false}) {
      if (last - first > 9 && similar) continue;
      const auto at_s = [&, from = first, to = last](std::uint32_t n) {
        return n * period_s + (n < from || n > to ? 0 : similar ? 10.74 : 0.37 * n * n);
      };
      check(timed(at_s), std::to_string(last - first + 1) + times, even);
    }
  const std::string still = "the board's clock stands still in ";
  check(timed([](auto n) { return (n - n % 2) * 0.0499; }), still + "29 frames (frame 3, ", even);
  check(timed([](auto n) { return std::min(n, 30u) * 0.0499; }), still + "30 frames (frame", even);
  check(timed([](auto n) { return (n > 20 && n < 40 ? 20 : n) * 0.0499; }),
        still + "19 frames (frame 21, ", even);
  for (const double slow_s : {0.25e-6, 0.0})
    check(timed([&](auto n) { return n * slow_s; }), still + "59 frames (frame 2, frame 3",
          counted);
  RadarFile blank, twice, twos, points{.tlv = 1};
  for (std::uint32_t n = 1; n <= 60; ++n)
    blank.frame(0, 0), twice.frames(n, n).frames(n, n), twos.frames(1 + n % 2, 1 + n % 2);
  check(blank, "the frames have neither number nor time: ", counted);
  check(twice, "60 duplicate frames were omitted", even);
  check(RadarFile().frames(1, 40).frames(21, 60), "20 duplicate frames were omitted", even);
  check(twos, "restarts of the board", even);
  points.frames(1, 59).tlv = 2;
  check(points.frames(60, 60), "59 of 60 frames have no range profile", {0, 0, 1});
  // The frame number of frame 20 is corrupted. Of the tested values, only 36 is close enough to 20
  // to look like a gap of 16 lost frames.
  for (const std::string number : {"36", "1044", "2147483668"})
    check(with(20, static_cast<std::uint32_t>(std::stoul(number)), 20 * period_s),
          numbers + "frame " + number + " after 0.90 s): their times", even);
  // A number at an end of the recording, neighbouring numbers, and exchanged numbers.
  check(with(60, 109, 60 * period_s), numbers + "frame 109 after 2.89 s)", even);
  check(with(1, 33, period_s), numbers + "frame 33 at the start)", even);
  check(RadarFile().frame(33, period_s).frame(34, 2 * period_s).frames(3, 60),
        "2 frames have impossible numbers", even);
  check(RadarFile().frames(1, 19).frame(21, 20 * period_s).frame(20, 21 * period_s).frames(22, 60),
        "2 frames have impossible numbers (frame 21 after 0.90 s, frame 20 after 0.90 s): ", even);
  // Restarts near the start and with similar clocks.
  const std::string again = "1 restarts of the board (between frames ";
  check(RadarFile().frames(1, 5).frames(1, 60, 4.1), again + "5 and 1 at 0.20 s)", {21, 20, 20, 4});
  check(RadarFile().frames(1, 20).frames(1, 25, 0.001), again + "20 and 1 at 0.95 s)", {21, 20, 4});
  check(RadarFile().frames(1, 20).frames(2, 60, 0.01), again + "20 and 2 at", {21, 20, 20, 18});
  check(RadarFile().frames(1, 20).frames(1, 20).frames(1, 20, 7),
        "2 restarts of the board (between frames 20 and 1 at 0.95 s, between frames 20 and 1 at "
        "1.95 s)",
        even);
  check(RadarFile().frames(1, 40).frames(41, 60, wrap_s + 1),
        "1 gaps in which the board's clock may have wrapped (between frames 40 and 41 at 1.95 s by "
        "1.05 s + n x 21.47 s): their lengths are ambiguous",
        {21, 19, 1, 19});
  const std::string other = " ms; expected 50.0 ms from the cfg; check that the recording was";
  check(RadarFile{.period_s = 0.0998}.frames(1, 20), "frame period 99.8" + other, {11, 9});
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
  const std::string other = "60 heat maps are unusable: the heat map has ";
  for (const auto& [tlv, samples, frames, words] :
       std::vector<std::tuple<std::uint32_t, std::uint32_t, std::uint64_t, std::string>>{
           {4, 64 * 8, 20, ""},
           {4, 64 * 12, 0, other + "768 samples in TLV 4, but the cfg"},
           {4, 64 * 4, 0, other + "256 samples in TLV 4, but the cfg"},
           {8, 64 * 8, 0, other + "512 samples in TLV 8, but the cfg"},
           {0, 0, 0, "no frame has a heat map: the fifth number of guiMonitor was 0"}}) {
    const RadarImport i =
        import_radar(RadarFile{.map_tlv = tlv, .map_samples = samples}.frames(1, 60).bytes,
                     source_dir + "/config/radar/xwr68xx_azimuth_50cm.cfg");
    CHECK(has(i.said, "heat map") == !words.empty());
    CHECK_THAT(i.said, Catch::Contains(words));
    CHECK(i.maps.at(1) == frames);
  }
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
  for (const auto& [text, saying] :
       {std::pair<std::string, const char*>{"", "file is empty"},
        {"{\"frame\": 1}\n", "file contains text; expected the data port's bytes"},
        {"sensorStart\r\nDone\r\nmmwDemo:/>", "file contains text of the command port"}})
    refuses({text.begin(), text.end()}, saying);
  const Bytes whole = RadarFile().frames(1, 20).bytes;
  refuses(saved_as_text(whole), "line ends were converted because the file was saved as text");
  // One byte CR is missing in each frame.
  Bytes shorter = whole;
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
  for (auto [file, saying] :
       {std::pair{RadarFile{.header = 36}, "from SDK 1 or 2.0 (header of 36 bytes)"},
        {{.header = 48}, "not from the out-of-box demo (header of 48 bytes)"},
        {{.header = 52}, "not from the out-of-box demo (header of 52 bytes)"},
        {{.length_error = 8}, "the TLV lengths include the TLV headers"},
        {{.tlv = 1}, "no frame has a range profile: the third number of guiMonitor"},
        {{.bins = 256},
         "20 frames have 256 bins, but the number of bins in the cfg is 64; check "}})
    refuses(file.frames(1, 20).bytes, saying);
  refuses({whole.begin(), whole.begin() + 100}, "file contains only part of a frame");
}

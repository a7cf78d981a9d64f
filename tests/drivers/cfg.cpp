// SPDX-License-Identifier: MIT
// Tests cfg files with errors that a board would reject, and cfg files with artefacts of text
// editors.
#include "drivers/radar/cfg.hpp"

#include <array>
#include <bit>
#include <cstdio>

#include "stock_cfg.hpp"

using namespace echofuse::radar;
using namespace echofuse::test;

TEST_CASE("the cfg parser reports values that the radar would refuse and computes the range axis") {
  const auto refusals = [](const std::string& from, const std::string& to) {
    const RadarProfile p = parse_profile(with(from, to), "x.cfg");
    CHECK(p.bins == std::bit_ceil(p.adc_samples));
    std::string all;
    for (const auto& line : p.refusals) all += (all.empty() ? "" : "\n") + line;
    return all;
  };
  const std::vector<std::array<std::string, 3>> cases{
      {"% a", "% b", ""},
      {"0 60 7", "0 77 7",
       "x.cfg:5: profileCfg sweeps 77 to 80.9837 GHz (limits 60 to 64 GHz); is the cfg for "
       "xWR14xx, 16xx or 18xx?"},
      {"0 60 7", "0 60.5 7",
       "x.cfg:5: profileCfg sweeps 60.5 to 64.4837 GHz (limits 60 to 64 GHz)"},
      {"1 256 12500", "1 512 12500",
       "x.cfg:5: profileCfg samples from 3 to 43.96 us, but the ramp ends at 24 us\n"
       "x.cfg:9: frameCfg needs 800 KiB for the radar cube and the detection matrix; the chip has "
       "768 KiB"},
      {"0 100 1", "0 2.5 1",
       "x.cfg:9: frameCfg has 96 chirps, which take 2.976 ms, but its period is 2.5 ms"},
      {"frameCfg 0 2", "frameCfg 0 3",
       "x.cfg:9: frameCfg uses chirp 3, which no chirpCfg of this frame defines"},
      {"chirpCfg 2 2", "chirpCfg 2 3",
       "x.cfg:9: frameCfg uses chirp 2, which no chirpCfg of this frame defines"},
      {"15 7 0", "15 5 0", "x.cfg:8: chirpCfg enables no transmitter of channelCfg"},
      {"chirpCfg 1 1 0", "chirpCfg 1 1 4",
       "x.cfg:7: chirpCfg requires profileCfg 4 before it\n"
       "x.cfg:7: chirpCfg '4' should be a whole number from 0 to 3"},
      {"chirpCfg 1 1 0 0", "chirpCfg 1 1 0 50000000",
       "x.cfg:7: chirpCfg sweeps 60.05 to 64.0337 GHz (limits 60 to 64 GHz)"},
      {"chirpCfg 1 1 0 0 0", "chirpCfg 1 1 0 0 1200",
       "x.cfg:7: chirpCfg sweeps 60 to 64.0123 GHz (limits 60 to 64 GHz)"},
      {"chirpCfg 1 1 0 0 0 0 0", "chirpCfg 1 1 0 0 0 0 3",
       "x.cfg:7: chirpCfg samples from 6 to 26.48 us, but the ramp ends at 24 us"},
      {"chirpCfg 1 1 0 0 0 0", "chirpCfg 1 1 0 0 0 3100",
       "x.cfg:7: chirpCfg '3100' should be a number from 0 to 40.95\n"
       "x.cfg:9: frameCfg has 96 chirps, which take 102.176 ms, but its period is 100 ms"},
      {"chirpCfg 0", "profileCfg 1 63.5 7 3 24 0 0 166 1 256 12500 0 0 30\nchirpCfg 0",
       "x.cfg:6: profileCfg sweeps 63.5 to 67.4837 GHz (limits 60 to 64 GHz)"},
      {"frameCfg 0", "frameCfg\t0",
       "x.cfg:9: column 9 has a tab; the firmware splits words at spaces only"},
      {"sensorStop", "\tsensorStop",
       "x.cfg:2: column 1 has a tab; the firmware splits words at spaces only"},
      {"15 7 0",
       "15\xc2\xa0"
       "7 0",
       "x.cfg:4: column 14 has a no-break space; the firmware splits words at spaces only"},
      {"sensorStop", "\x0csensorStop",
       "x.cfg:2: column 1 has a control character; the firmware splits words at spaces only"},
      {"15 7 0", "15 7 0\xe2\x80\x8b",
       "x.cfg:4: column 18 has a non-ASCII character; the firmware splits words at spaces only"},
      {"0 100 1 0", "0 100 1 0 % 10 Hz",
       "x.cfg:9: frameCfg '%' follows the numbers; put comments on their own line"},
      {"0 100 1 0", "0 100 1 0 8",
       "x.cfg:9: frameCfg has 8 numbers; SDK 3.4 to 3.6 expect 7 (SDK 1 and 2 differ)"},
      {"sensorStart", "calibData 1 0 0x1F0000\nsensorStart", ""},
      {"sensorStart", "calibData 1 1 0\nsensorStart",
       "x.cfg:26: calibData saves and restores at once; the demo does only one of both"},
      {"lvdsStreamCfg -1 0 0 0", "lvdsStreamCfg -1 0 1 1",
       "x.cfg:25: lvdsStreamCfg streams samples and results without a header, which the demo "
       "requires"},
      {"cfarCfg -1 1", "cfarCfg 1 1",
       "x.cfg:26: sensorStart requires cfarCfg -1 1 for subframe 0 before it"},
      {"% a", "# a", "x.cfg:1: # is not a command; comments begin with %"},
      {"sensorStart", "peakGrouping 1 1 1 1 229\nsensorStart",
       "x.cfg:26: peakGrouping is a command of SDK 1 or 2"},
      {"sensorStart", "sensorStart 0",
       "x.cfg:26: sensorStart has an argument, which the firmware refuses after new settings"},
      {"sensorStart", "sensorStart\nsensorStop",
       "x.cfg:27: sensorStop stops the radar that sensorStart started"},
      {"sensorStart", "myCfg 1\nsensorStart",
       "x.cfg:26: myCfg is not a command of the demo of SDK 3.4 to 3.6"},
      {"sensorStart", "bpmCfg -1 0 0 a\nsensorStart", "x.cfg:26: bpmCfg 'a' is not a number"}};
  for (const auto& [from, to, line] : cases) CHECK(refusals(from, to) == line);
  CHECK(refusals("15 7 0", "15 7") ==
        "x.cfg:4: channelCfg has 2 numbers; SDK 3.4 to 3.6 expect 3 (SDK 1 and 2 differ)");
}

TEST_CASE("the end frequency of a chirp is computed in register steps of the radar chip") {
  const std::string profile = "0 60 7 3 24 0 0 166 1 256 12500 0 0 30";
  const RadarProfile p =
      parse_profile(with(profile, "0 60 84 7 88.89 0 0 45 1 176 2175 0 0 158"), "x.cfg");
  CHECK(p.refusals.empty());
  CHECK(p.carrier_hz == Approx(60e9 + 44.9724e12 * (7 + 0.5 * 176 / 2.175) * 1e-6).epsilon(1e-6));
  // Tests sweeps over the full bandwidth. The values are rounded as in TI's tool.
  for (int slope = 20; slope <= 250; ++slope) {
    char text[80];
    std::snprintf(text, sizeof text, "0 60 7 3 %.2f 0 0 %d 1 16 12500 0 0 30", 4e3 / slope, slope);
    CHECK(parse_profile(with(profile, text), "x.cfg").refusals.empty());
  }
  CHECK(parse_profile(with(profile, "0 60 84 7 88.89 0 0 45.04 1 176 2175 0 0 158"), "x.cfg")
            .refusals.at(0) ==
        "x.cfg:5: profileCfg sweeps 60 to 64.0008 GHz (limits 60 to 64 GHz)");
}

TEST_CASE(
    "a radar cfg in UTF-8 with a BOM is read, and a CR without an LF gives a one-line error") {
  CHECK(parse_profile("\xef\xbb\xbf" + stock, "x.cfg").refusals.empty());
  CHECK(parse_profile("\xef\xbb\xbf" + stock.substr(13), "x.cfg").refusals.empty());
  std::string other = stock;
  std::erase(other, '\r');
  CHECK(parse_profile(other, "x.cfg").refusals.empty());
  std::ranges::replace(other, '\n', '\r');
  const std::string ends =
      ": has a carriage return without a line feed; expected lines that end in LF or CR LF";
  CHECK(refusal(other) == "x.cfg:1" + ends);
  CHECK(refusal(with("15 7 0\r\n", "15 7 0\r")) == "x.cfg:4" + ends);
}

TEST_CASE("a radar cfg of another TI demo is reported in one line before the board is opened") {
  for (const auto& [line, whose] : {std::pair{"chirpComnCfg 8 0 0 128 4 28 0", "xWRL6432"},
                                    {"trackingCfg 1 2 800 30 46 96 55", "people counting"}})
    CHECK_THAT(refusal(line), Catch::StartsWith("x.cfg:1: ") && Catch::Contains(whose) &&
                                  Catch::Contains("out-of-box demo of SDK 3.4 to 3.6"));
  CHECK(refusal(with("-1 1 1 0 0 0 1", "1 1 0 0 0 1")) ==
        "x.cfg:10: guiMonitor has 6 numbers; SDK 3.4 to 3.6 expect 7 (SDK 1 and 2 differ)");
}

TEST_CASE("only the first errors of a radar cfg with thousands of faulty lines are listed") {
  std::string text = stock;
  for (int i = 0; i < 2000; ++i) text += "chirpCfg x" + std::to_string(i) + "\n";
  const std::string lines = refusal(text);
  CHECK(std::ranges::count(lines, '\n') == 20);
  CHECK_THAT(lines, Catch::EndsWith("there are more errors; the list ends after the first 20"));
  CHECK(refusal(stock + std::string(1 << 19, '%')) ==
        "x.cfg: has " + std::to_string(stock.size() + (1 << 19)) +
            " bytes; expected a cfg of at most 65536");
}

TEST_CASE("the chirps of a radar frame use one profile, and one transmitter each without BPM") {
  const std::string other = "profileCfg 1 60 7 3 24 0 0 83 1 128 12500 0 0 30\r\nchirpCfg 0";
  const RadarProfile unused = parse_profile(with("chirpCfg 0", other), "x.cfg");
  CHECK(unused.bins == 256);
  CHECK(unused.range_step_m == parse_profile(stock, "").range_step_m);
  CHECK(refusal(with("chirpCfg 0 0 0", other + " 0 1")) ==
        "x.cfg:8: chirpCfg uses profileCfg 0, but the first chirp of the frame uses 1; the demo "
        "supports one profile per frame");
  CHECK(refusal(with("0 0 0 0 4", "0 0 0 0 5")) ==
        "x.cfg:7: chirpCfg enables several transmitters; echofuse supports this only with BPM "
        "(bpmCfg)");
  CHECK(refusal("% a comment\n") == "x.cfg: contains no command; expected a TI mmWave .cfg file");
}

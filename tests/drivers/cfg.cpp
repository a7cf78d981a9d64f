// SPDX-License-Identifier: MIT
// Tests cfg files with errors that a board would reject, with unwanted effects, and with artefacts
// of text editors.
#include "drivers/radar/cfg.hpp"

#include <bit>

#include "../fixtures/folder.hpp"
#include "../fixtures/shell.hpp"
#include "stock_cfg.hpp"

using namespace echofuse::radar;
using namespace echofuse::test;

namespace {

struct Row {
  std::string from, to;  // change of a cfg
  std::string lines;     // lines of the message, each without "x.cfg:"
};

const std::string limits = " GHz (limits 60 to 64 GHz)", before = " before it",
                  spaces = "; the firmware splits words at spaces only",
                  differ = " (SDK 1 and 2 differ)", expect = " numbers; SDK 3.4 to 3.6 expect ",
                  whole = " should be a whole number from ", number = " should be a number from ";

// Joins the lines, and removes the name of the cfg from each.
std::string joined(const std::vector<std::string>& lines) {
  std::string all;
  for (const std::string& line : lines) all += (all.empty() ? "" : "\n") + line;
  for (std::size_t at; (at = all.find("x.cfg:")) != all.npos;) all.erase(at, 6);
  return all;
}

std::string faults(const std::string& text) {
  std::vector<std::string> lines;
  const std::string thrown = refusal_by([&] { lines = parse_profile(text, "x.cfg").refusals; });
  return joined(thrown.empty() ? lines : std::vector{thrown});
}

}  // namespace

TEST_CASE("the cfg parser reports lines and values that the radar would refuse") {
  const auto row = GENERATE(values<Row>(
      {{"% a", "% b", ""},
       {"0 60 7", "0 77 7",
        "5: profileCfg sweeps 77 to 80.9837" + limits + "; is the cfg for xWR14xx, 16xx or 18xx?"},
       {"0 60 7", "0 60.5 7", "5: profileCfg sweeps 60.5 to 64.4837" + limits},
       {"1 256 12500", "1 512 12500",
        "5: profileCfg samples from 3 to 43.96 us, but the ramp ends at 24 us\n"
        "9: frameCfg needs 800 KiB for the radar cube and the detection matrix; the chip has 768 "
        "KiB"},
       {"0 100 1", "0 2.5 1",
        "9: frameCfg has 96 chirps, which take 2.976 ms, but its period is 2.5 ms"},
       {"frameCfg 0 2", "frameCfg 0 3",
        "9: frameCfg uses chirp 3, which no chirpCfg of this frame defines"},
       {"15 7 0", "15 5 0", "8: chirpCfg enables no transmitter of channelCfg"},
       {"chirpCfg 1 1 0", "chirpCfg 1 1 4",
        "7: chirpCfg requires profileCfg 4" + before + "\n7: chirpCfg '4'" + whole + "0 to 3"},
       {"chirpCfg 1 1 0 0", "chirpCfg 1 1 0 50000000",
        "7: chirpCfg sweeps 60.05 to 64.0337" + limits},
       {"chirpCfg 1 1 0 0 0", "chirpCfg 1 1 0 0 1200", "7: chirpCfg sweeps 60 to 64.0123" + limits},
       {"chirpCfg 1 1 0 0 0 0 0", "chirpCfg 1 1 0 0 0 0 3",
        "7: chirpCfg samples from 6 to 26.48 us, but the ramp ends at 24 us"},
       {"chirpCfg 1 1 0 0 0 0", "chirpCfg 1 1 0 0 0 3100",
        "7: chirpCfg '3100'" + number +
            "0 to 40.95\n"
            "9: frameCfg has 96 chirps, which take 102.176 ms, but its period is 100 ms"},
       {"chirpCfg 0", "profileCfg 1 63.5 7 3 24 0 0 166 1 256 12500 0 0 30\nchirpCfg 0",
        "6: profileCfg sweeps 63.5 to 67.4837" + limits},
       {"frameCfg 0", "frameCfg\t0", "9: column 9 has a tab" + spaces},
       {"sensorStop", "\tsensorStop", "2: column 1 has a tab" + spaces},
       {"15 7 0", "15\xc2\xa0 7 0", "4: column 14 has a no-break space" + spaces},
       {"sensorStop", "\x0csensorStop", "2: column 1 has a control character" + spaces},
       {"15 7 0", "15 7 0\xe2\x80\x8b", "4: column 18 has a non-ASCII character" + spaces},
       {"0 100 1 0", "0 100 1 0 % 10 Hz",
        "9: frameCfg '%' follows the numbers; put comments on their own line"},
       {"0 100 1 0", "0 100 1 0 8", "9: frameCfg has 8" + expect + "7" + differ},
       {"-1 1 1 0 0 0 1", "1 1 0 0 0 1", "10: guiMonitor has 6" + expect + "7" + differ},
       {"sensorStart", "calibData 1 0 0x1F0000\nsensorStart", ""},
       {"sensorStart", "calibData 1 1 0\nsensorStart",
        "26: calibData saves and restores at once; the demo does only one of both"},
       {"0 -5 8 256", "0 -24 8 256",
        "16: calibDcRangeSig has more than 32 bins (limit of the demo)"},
       {"0 -5 8 256", "0 -23 8 256", ""},
       {"lvdsStreamCfg -1 0 0 0", "lvdsStreamCfg -1 0 1 1",
        "25: lvdsStreamCfg streams samples and results without a header, which the demo requires"},
       {"cfarCfg -1 1", "cfarCfg 1 1",
        "26: sensorStart requires cfarCfg -1 1 for subframe 0" + before},
       {"% a", "# a", "1: # is not a command; comments begin with %"},
       {"sensorStart", "peakGrouping 1 1 1 1 229\nsensorStart",
        "26: peakGrouping is a command of SDK 1 or 2"},
       {"sensorStart", "sensorStart 0",
        "26: sensorStart has an argument, which the firmware refuses after new settings"},
       {"sensorStart", "sensorStart\nsensorStop",
        "27: sensorStop stops the radar that sensorStart started"},
       // ~ is the last printable character.
       {"sensorStop", "sensorStop~",
        "2: sensorStop~ is not a command of the demo of SDK 3.4 to 3.6"},
       {"sensorStart", "myCfg 1\nsensorStart",
        "26: myCfg is not a command of the demo of SDK 3.4 to 3.6"},
       {"sensorStart", "bpmCfg -1 0 0 a\nsensorStart", "26: bpmCfg 'a' is not a number"},
       {"sensorStart", "", " has no sensorStart"},
       {"guiMonitor -1 1 1 0 0 0 1\r\n", "", "25: sensorStart requires guiMonitor" + before},
       {"166 1 256", "0 1 256", "5: profileCfg '0'" + number + "0.0363 to 250"},
       {"1 256 12500", "1 256 1.25e4", "5: profileCfg '1.25e4'" + whole + "2000 to 37500"},
       {"1 256 12500", "1 25.5 12500", "5: profileCfg '25.5'" + whole + "2 to 1024"},
       {"frameCfg 0 2", "frameCfg 5 6", "9: frameCfg uses no chirp with an enabled transmitter"},
       {"0 100 1 0", "0 0 1 0", "9: frameCfg '0'" + number + "0.3 to 1342"},
       {"0 0 0 0 4", "0 0 0 0 5",
        "7: chirpCfg enables several transmitters; echofuse supports this only with BPM (bpmCfg)"},
       {"15 7 0\r\n", "15 7 0\r",
        "4: has a carriage return without a line feed; expected lines that end in LF or CR LF"}}));
  CAPTURE(row.from, row.to);
  CHECK(faults(with(row.from, row.to)) == row.lines);
}

TEST_CASE("all faults in a radar cfg are reported together") {
  CHECK(faults("flushCfg") ==
        " has no profileCfg\n has no frameCfg\n has no channelCfg\n has no chirpCfg\n"
        " has no guiMonitor\n has no sensorStart");
  CHECK(faults("channelCfg 15 9 0\nprofileCfg 0 60 7 3 24 0 0 fast 1 1 0 0 0 30\n"
               "chirpCfg 0 0 0 0 0 0 0 1\nframeCfg 0 0 16 0 -1 1 0\nguiMonitor -1 0\n"
               "sensorStart\n") ==
        "1: channelCfg '9' should be a whole number from 1 to 7\n"
        "2: profileCfg requires dfeDataOutputMode before it\n"
        "2: profileCfg 'fast' is not a number\n"
        "4: frameCfg requires dfeDataOutputMode 1 before it\n"
        "4: frameCfg '-1' should be a number from 0.3 to 1342\n"
        "5: guiMonitor has 2 numbers; SDK 3.4 to 3.6 expect 7 (SDK 1 and 2 differ)\n"
        "6: sensorStart requires adcCfg, adcbufCfg, cfarCfg -1 0, cfarCfg -1 1, "
        "multiObjBeamForming, calibDcRangeSig, clutterRemoval, compRangeBiasAndRxChanPhase, "
        "measureRangeBiasAndRxChanPhase, aoaFovCfg, cfarFovCfg -1 0, cfarFovCfg -1 1, "
        "extendedMaxVelocity, analogMonitor, lvdsStreamCfg before it\n"
        "2: profileCfg '1' should be a whole number from 2 to 1024\n"
        "2: profileCfg '0' should be a whole number from 2000 to 37500");
}

TEST_CASE("a radar cfg with excessive lines is refused, and only the first errors are listed") {
  std::string text = stock;
  for (int i = 0; i < 2000; ++i) text += "chirpCfg x" + std::to_string(i) + "\n";
  const std::string lines = faults(text);
  CHECK(std::ranges::count(lines, '\n') == 20);
  CHECK(lines.ends_with("there are more errors; the list ends after the first 20"));
  CHECK(faults(std::string(65'536, '%')) == " contains no command; expected a TI mmWave .cfg file");
  CHECK(faults(std::string(65'537, '%')) == " has 65537 bytes; expected a cfg of at most 65536");
  const auto long_line = [](std::size_t size) { return faults("calib " + std::string(size, '1')); };
  CHECK(has(long_line(250), "1: calib line has 256 characters (limit of the firmware: 255)"));
  CHECK_FALSE(has(long_line(249), "characters"));
  std::string words = "calib";
  for (int i = 0; i < 39; ++i) words += " 1";
  CHECK_FALSE(has(faults(words), "words"));
  CHECK(has(faults(words + " 1"), "1: calib line has more than 40 words (limit of the firmware)"));
}

TEST_CASE(
    "a radar cfg in UTF-8 with a BOM is read, and a CR without an LF gives a one-line error") {
  CHECK(parse_profile("\xef\xbb\xbf" + stock, "x.cfg").refusals.empty());
  CHECK(parse_profile("\xef\xbb\xbf" + stock.substr(13), "x.cfg").refusals.empty());
  std::string other = stock;
  std::erase(other, '\r');
  CHECK(parse_profile(other, "x.cfg").refusals.empty());
  std::ranges::replace(other, '\n', '\r');
  CHECK(faults(other).starts_with("1: has a carriage return without a line feed"));
}

TEST_CASE("a radar cfg of another TI demo is reported in one line before the board is opened") {
  for (const auto& [line, whose] : {std::pair{"chirpComnCfg 8 0 0 128 4 28 0", "xWRL6432"},
                                    {"trackingCfg 1 2 800 30 46 96 55", "people counting"}})
    CHECK_THAT(faults(line), Catch::StartsWith("1: ") && Catch::Contains(whose) &&
                                 Catch::Contains("out-of-box demo of SDK 3.4 to 3.6"));
}

TEST_CASE("radar cfg settings with unwanted effects cause warnings") {
  const std::string rate = "0 100 1 0";
  const auto [from, to, baud, lines] = GENERATE_COPY(table<std::string, std::string, std::uint32_t,
                                                           std::string>(
      {{"-1 1 1 0", "-1 1 0 0", 921600, "10: guiMonitor does not send the range profile"},
       {"clutterRemoval -1 0", "clutterRemoval -1 1", 921600, "17: clutterRemoval"},
       {"clutterRemoval -1 0", "clutterRemoval 0 1\nclutterRemoval 1 0", 921600,
        "17: clutterRemoval"},
       {rate, "30 100 2 0", 921600,
        "9: frameCfg stops after 30 frames (0 means no limit)\n9: frameCfg trigger 2 waits for an "
        "external pulse before each frame (1 does not wait)"},
       {"1 256 12500", "1 1024 12500", 921600, "5: profileCfg gives 1024 bins for 12 antennas"},
       {"sensorStart", "configDataPort 460800 0\nsensorStart", 460800, ""},
       {"sensorStart", "configDataPort 460800 0\nsensorStart", 921600,
        "26: configDataPort sets the data port to 460800 baud, but radar.data_baud is 921600"},
       {"sensorStart", "sensorStart\nconfigDataPort 921600 0", 921600, ""},
       {"sensorStart", "sensorStart\nguiMonitor -1 1 0 0 0 0 1", 921600,
        "27: guiMonitor has no effect after sensorStart"},
       {"% a", "% b", 460800,
        " without configDataPort the firmware sends at 921600 baud, but radar.data_baud is 460800"},
       {rate, "0 5 1 0", 921600,
        "9: frameCfg requests a frame every 5 ms, but a frame of 640 bytes takes 6.9 ms at 921600 "
        "baud"},
       {rate, "0 7 1 0", 921600, ""}}));
  CAPTURE(from, to);
  const RadarProfile p = parse_profile(with(from, to), "x.cfg", baud);
  const std::string warnings = joined(p.warnings);
  CHECK(warnings.starts_with(lines));
  CHECK(warnings.empty() == lines.empty());
  CHECK(p.range_profile_on == (from != "-1 1 1 0"));
}

namespace {

std::string four_subframes() { return contents(source_dir + "/tests/drivers/four_subframes.cfg"); }

std::string changed(const std::string& from, const std::string& to) {
  return with(from, to, four_subframes());
}

}  // namespace

TEST_CASE(
    "radar subframes that differ in start frequency share one axis and send one packet each") {
  const std::string paper = contents(source_dir + "/config/radar/xwr68xx_paper_50cm.cfg");
  const RadarProfile p = parse_profile(four_subframes(), "x.cfg"),
                     one = parse_profile(paper, "y.cfg");
  CHECK(p.warnings.empty());
  CHECK(p.subframes == 4);
  CHECK(one.subframes == 1);
  CHECK(same_axis(radar_axis(p), radar_axis(one)));
  CHECK(p.frame_bytes == one.frame_bytes);
  CHECK(p.frame_period_s == 0.0125);
  std::string uneven = four_subframes();
  uneven.replace(uneven.rfind("1 1 12.5"), 8, "1 1 62.5");
  CHECK(parse_profile(uneven, "x.cfg").frame_period_s == Approx(0.025));
}

TEST_CASE(
    "radar subframes that differ in slope, samples or antennas are refused with the line number") {
  const std::string mean = "; a record is the mean of all subframes",
                    axis =
                        "33: subFrameCfg has a different range axis or different antennas than "
                        "subframe 0" +
                        mean;
  const std::string
      gui = "guiMonitor -1 0 1 0 0 0 1",
      each = "guiMonitor 0 0 1 0 0 0 1\nguiMonitor 1 0 1 0 0 0 1\nguiMonitor 2 0 1 0 0 0 1\n";
  const auto row = GENERATE_COPY(values<Row>(
      {// Only the slope, only the number of samples or only the number of antennas differs.
       {"18.75 1 60 2000 0 0 30\nchirp", "15 1 60 2000 0 0 30\nchirp", axis},
       {"1 60 2000 0 0 30\nchirp", "1 64 2000 0 0 30\nchirp", axis},
       {"subFrameCfg 3 0 9 3", "subFrameCfg 3 0 9 2", axis},
       {gui, each + "guiMonitor 3 0 1 0 0 0 1", ""},
       {gui, each + "guiMonitor 3 0 0 0 0 0 1",
        "34: guiMonitor requests other data than the last guiMonitor" + mean},
       {gui, "guiMonitor 2 0 1 0 0 0 1",
        "52: sensorStart requires guiMonitor for subframe 0" + before},
       {"subFrameCfg 2 0", "subFrameCfg 1 0", "29: advFrameCfg has no subFrameCfg 2"},
       {"advFrameCfg 4", "% advFrameCfg 4", "30: subFrameCfg requires advFrameCfg" + before}}));
  CHECK(faults(changed(row.from, row.to)) == row.lines);
}

TEST_CASE("the chirps of a radar frame use one profile") {
  const std::string other = "profileCfg 1 60 7 3 24 0 0 83 1 128 12500 0 0 30\r\nchirpCfg 0";
  const RadarProfile unused = parse_profile(with("chirpCfg 0", other), "x.cfg");
  CHECK(unused.bins == 256);
  CHECK(unused.range_step_m == parse_profile(stock, "").range_step_m);
  CHECK(faults(with("chirpCfg 0 0 0", other + " 0 1")) ==
        "8: chirpCfg uses profileCfg 0, but the first chirp of the frame uses 1; the demo "
        "supports one profile per frame");
}

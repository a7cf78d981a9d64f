// SPDX-License-Identifier: MIT

#include "../fixtures/folder.hpp"
#include "../fixtures/shell.hpp"
#include "drivers/radar/log2_codes.hpp"
#include "stock_cfg.hpp"

using namespace echofuse::radar;
using namespace echofuse::test;

namespace {

// Range step for a chirp slope of 166 MHz/us. The chip rounds this slope to 4584 register steps,
// each 2.7 GHz * 900 / 2^26 per microsecond.
constexpr double played_step_m =
    299'792'458.0 * 12.5e6 / (2 * (4584 * 2.7e15 * 900 / (1 << 26)) * 256);

}  // namespace

TEST_CASE("TI's stock radar profile gives 256 bins of 4.4 cm and 12 antennas") {
  const RadarProfile p = parse_profile(stock, "x.cfg");
  CHECK(p.adc_samples == 256);
  CHECK(p.bins == 256);
  CHECK(p.antennas == 12);
  CHECK(p.range_step_m == Approx(played_step_m).epsilon(1e-12));
  CHECK(p.resolution_m == p.range_step_m);
  CHECK(p.frame_period_s == 0.1);
  CHECK(p.range_profile_on);
  CHECK(p.warnings.empty());
  CHECK(
      same_axis(radar_axis(p), Axis{"radar", "power_with_noise", "m", 256, 0, p.range_step_m, 1}));
}

TEST_CASE(
    "antennas are counted from the chirps, and the bin count is rounded up to a power of two") {
  CHECK(parse_profile(with("frameCfg 0 2", "frameCfg 0 1"), "").antennas == 8);
  CHECK(parse_profile(with("channelCfg 15 7", "channelCfg 5 5"), "").antennas == 4);
  const RadarProfile odd = parse_profile(with("1 256 12500", "1 240 12500"), "");
  CHECK(odd.bins == 256);
  CHECK(odd.range_step_m == parse_profile(stock, "").range_step_m);
  CHECK(odd.resolution_m == Approx(256 * odd.range_step_m / 240));
  const RadarProfile big = parse_profile(with("1 256 12500", "1 1024 12500"), "");
  CHECK(big.bins == 1022);
  CHECK(big.range_step_m == Approx(played_step_m / 4).epsilon(1e-12));
}

TEST_CASE("the radar range axis is computed from the rounded chirp slope of the chip") {
  const auto step = [](const char* slope) {
    return parse_profile(with("166 1 256", std::string(slope) + " 1 256"), "").range_step_m;
  };
  CHECK(step("166") == step("165.99"));  // both slopes are rounded to 4584 register steps
  // The chip rounds this slope to 4583 register steps.
  CHECK(step("165.98") == Approx(played_step_m * 4584 / 4583));
  CHECK_THROWS_WITH(step("0.03"), Catch::Contains("from 0.0363 to 250"));
  const double nominal_m = 3.0e8 * 12.5e6 / (2 * 166e12 * 256);
  // At 7 m, the nominal range step causes a range error of 4.2 mm.
  CHECK(7 * (played_step_m / nominal_m - 1) == Approx(-4.2e-3).epsilon(0.05));
}

TEST_CASE("radar cfg lines are sent unchanged except for CR, blank lines and comments") {
  const auto lines = command_lines("a  b \r\n\r\n% c\n  % d\n  e\n\nf");
  REQUIRE(lines.size() == 3);
  CHECK(lines[0].text == "a  b ");
  CHECK(lines[1].text == "  e");
  CHECK(lines[1].number == 5);
  CHECK(lines[2].text == "f");
  CHECK(lines[2].number == 7);
}

TEST_CASE("errors in a radar cfg are reported with the line number") {
  CHECK(refusal("flushCfg") ==
        "x.cfg: has no profileCfg\nx.cfg: has no frameCfg\nx.cfg: has no channelCfg\n"
        "x.cfg: has no chirpCfg\nx.cfg: has no guiMonitor\nx.cfg: has no sensorStart");
  CHECK(refusal(with("sensorStart", "")) == "x.cfg: has no sensorStart");
  CHECK(refusal(with("guiMonitor -1 1 1 0 0 0 1\r\n", "")) ==
        "x.cfg:25: sensorStart requires guiMonitor before it");
  CHECK(refusal(with("1 256 12500 0 0 30", "1 256")) ==
        "x.cfg:5: profileCfg has 10 numbers; SDK 3.4 to 3.6 expect 14 (SDK 1 and 2 differ)");
  CHECK(refusal(with("1 256 12500", "1 256 fast")) == "x.cfg:5: profileCfg 'fast' is not a number");
  CHECK(refusal(with("166 1 256", "0 1 256")) ==
        "x.cfg:5: profileCfg '0' should be a number from 0.0363 to 250");
  CHECK(refusal(with("1 256 12500", "1 256 1.25e4")) ==
        "x.cfg:5: profileCfg '1.25e4' should be a whole number from 2000 to 37500");
  CHECK(refusal(with("1 256 12500", "1 25.5 12500")) ==
        "x.cfg:5: profileCfg '25.5' should be a whole number from 2 to 1024");
  CHECK(refusal(with("frameCfg 0 2", "frameCfg 5 6")) ==
        "x.cfg:9: frameCfg uses no chirp with an enabled transmitter");
  CHECK(refusal(with("0 100 1 0", "0 0 1 0")) ==
        "x.cfg:9: frameCfg '0' should be a number from 0.3 to 1342");
  CHECK_THAT(refusal(with("% a comment", "calib " + std::string(300, '1'))),
             Catch::StartsWith("x.cfg:1: calib line has 306 characters"));
}

TEST_CASE("all faults in a radar cfg are reported together") {
  const std::string bad = refusal(
      "channelCfg 15 9 0\nprofileCfg 0 60 7 3 24 0 0 fast 1 1 0 0 0 30\nchirpCfg 0 0 0 0 0 0 0 1\n"
      "frameCfg 0 0 16 0 -1 1 0\nguiMonitor -1 0\nsensorStart\n");
  CHECK(bad ==
        "x.cfg:1: channelCfg '9' should be a whole number from 1 to 7\n"
        "x.cfg:2: profileCfg requires dfeDataOutputMode before it\n"
        "x.cfg:2: profileCfg 'fast' is not a number\n"
        "x.cfg:4: frameCfg requires dfeDataOutputMode 1 before it\n"
        "x.cfg:4: frameCfg '-1' should be a number from 0.3 to 1342\n"
        "x.cfg:5: guiMonitor has 2 numbers; SDK 3.4 to 3.6 expect 7 (SDK 1 and 2 differ)\n"
        "x.cfg:6: sensorStart requires adcCfg, adcbufCfg, cfarCfg -1 0, cfarCfg -1 1, "
        "multiObjBeamForming, calibDcRangeSig, clutterRemoval, compRangeBiasAndRxChanPhase, "
        "measureRangeBiasAndRxChanPhase, aoaFovCfg, cfarFovCfg -1 0, cfarFovCfg -1 1, "
        "extendedMaxVelocity, analogMonitor, lvdsStreamCfg before it\n"
        "x.cfg:2: profileCfg '1' should be a whole number from 2 to 1024\n"
        "x.cfg:2: profileCfg '0' should be a whole number from 2000 to 37500");
}

TEST_CASE("radar cfg settings with unwanted effects cause warnings") {
  const auto warnings = [](const std::string& text) {
    return parse_profile(text, "x.cfg").warnings;
  };
  CHECK_THAT(warnings(with("-1 1 1 0", "-1 1 0 0")).at(0),
             Catch::StartsWith("x.cfg:10: guiMonitor does not send the range profile"));
  CHECK_FALSE(parse_profile(with("-1 1 1 0", "-1 1 0 0"), "").range_profile_on);
  for (const char* line : {"clutterRemoval -1 1", "clutterRemoval 0 1\nclutterRemoval 1 0"})
    CHECK_THAT(warnings(with("clutterRemoval -1 0", line)).at(0),
               Catch::StartsWith("x.cfg:17: clutterRemoval"));
  CHECK(warnings(with("0 100 1 0", "30 100 2 0")) ==
        std::vector<std::string>{"x.cfg:9: frameCfg stops after 30 frames (0 means no limit)",
                                 "x.cfg:9: frameCfg trigger 2 waits for an external pulse before "
                                 "each frame (1 does not wait)"});
  CHECK_THAT(warnings(with("1 256 12500", "1 1024 12500")).at(0),
             Catch::StartsWith("x.cfg:5: profileCfg gives 1024 bins for 12 antennas") &&
                 Catch::EndsWith("memory for 1022"));
}

TEST_CASE(
    "a radar data rate that does not suit the cfg, configuration or frame period is reported") {
  const auto warnings = [](const std::string& text, std::uint32_t baud) {
    return parse_profile(text, "x.cfg", baud).warnings;
  };
  const std::string slow = with("sensorStart", "configDataPort 460800 0\nsensorStart");
  CHECK(warnings(slow, 460800).empty());
  CHECK(warnings(slow, 921600) ==
        std::vector<std::string>{"x.cfg:26: configDataPort sets the data port to 460800 baud, "
                                 "but radar.data_baud is 921600"});
  CHECK(warnings(stock, 460800) ==
        std::vector<std::string>{"x.cfg: without configDataPort the firmware sends at 921600 baud, "
                                 "but radar.data_baud is 460800"});
  CHECK(warnings(with("0 100 1 0", "0 5 1 0"), 921600) ==
        std::vector<std::string>{
            "x.cfg:9: frameCfg requests a frame every 5 ms, but a frame of 640 bytes "
            "takes 6.9 ms at 921600 baud"});
  CHECK(warnings(with("0 100 1 0", "0 7 1 0"), 921600).empty());
}

TEST_CASE("the computed radar frame size matches the firmware's tables") {
  const auto bytes = [](const std::string& from, const std::string& to) {
    // The frame period of the stock cfg is too short for a heat map.
    return parse_profile(with("0 100 1 0", "0 200 1 0", with(from, to)), "").frame_bytes;
  };
  const std::string gui = "guiMonitor -1 1 1 0 0 0 1";
  CHECK(bytes(gui, "guiMonitor -1 0 1 0 0 0 0") == 576);
  CHECK(bytes(gui, "guiMonitor -1 0 1 0 0 0 1") == 640);
  CHECK(bytes(gui, "guiMonitor -1 0 1 1 0 0 1") == 1152);
  // The frame has 40 + 8 + 256 * 8 * 4 bytes, padded to a multiple of 32.
  CHECK(bytes(gui, "guiMonitor -1 0 0 0 1 0 0") == 8256);
  // The frame has 40 + 8 + 256 * 32 * 2 bytes, padded to a multiple of 32.
  CHECK(bytes(gui, "guiMonitor -1 0 0 0 0 1 0") == 16448);
}

namespace {

std::vector<int> columns(const RadarProfile& p) {
  std::vector<int> x;
  for (const AntennaPlace& a : p.array) x.push_back(a.x);
  return x;
}

}  // namespace

TEST_CASE("the antenna order of a heat map depends on the board and the order of the chirps") {
  const std::string gui = "guiMonitor -1 1 1 0 0 0 1", on = "guiMonitor -1 0 1 0 1 0 1";
  const auto profile = [&](const std::string& text, Board board = Board::isk) {
    return parse_profile(with(gui, on, with("0 100 1 0", "0 200 1 0", text)), "x.cfg", 921600,
                         board);
  };
  CHECK(parse_profile(stock, "").array.empty());
  const RadarProfile isk = profile(stock);
  CHECK(columns(isk) == std::vector<int>{0, 1, 2, 3, 4, 5, 6, 7});
  CHECK_FALSE(isk.planar);
  CHECK(isk.warnings.empty());
  // The frame has 40 + 8 + 512 + 8 + 8192 + 8 + 24 + 8 + 28 bytes, padded to a multiple of 32.
  CHECK(isk.frame_bytes == 8832);
  CHECK(same_axis(array_axis(isk), Axis{"array", "covariance", "m", 256, 0, isk.range_step_m, 8}));
  CHECK(columns(profile(with("channelCfg 15 7", "channelCfg 5 1"))) == std::vector<int>{0, 2});
  CHECK(columns(profile(with("channelCfg 15 7", "channelCfg 15 4"))) ==
        std::vector<int>{4, 5, 6, 7});
  const RadarProfile aop = profile(stock, Board::aop), ods = profile(stock, Board::ods);
  CHECK(aop.planar);
  CHECK(aop.frame_bytes == 12928);
  // Each antenna has a position of its own. Each board leaves different positions of the grid
  // empty.
  const std::vector<AntennaPlace> of_aop{{1, 1}, {1, 0}, {0, 1}, {0, 0}, {1, 3}, {1, 2},
                                         {0, 3}, {0, 2}, {3, 3}, {3, 2}, {2, 3}, {2, 2}};
  const std::vector<AntennaPlace> of_ods{{0, 0}, {0, 1}, {1, 1}, {1, 0}, {2, 2}, {2, 3},
                                         {3, 3}, {3, 2}, {2, 0}, {2, 1}, {3, 1}, {3, 0}};
  CHECK(aop.array == of_aop);  // the stock cfg uses the transmitters in the order 1, 3, 2
  CHECK(ods.array == of_ods);
}

TEST_CASE(
    "an unusable heat map causes a warning, and one too large for the frame period is refused") {
  const std::string text = with("guiMonitor -1 1 1 0 0 0 1", "guiMonitor -1 0 1 0 1 0 1");
  const auto warnings = [&](const std::string& from, const std::string& to, Board board) {
    return parse_profile(with(from, to, text), "x.cfg", 921600, board).warnings;
  };
  const auto refusal = [&](const std::string& to, Board board) {
    return refusal_by([&] { warnings("0 100 1 0", to, board); });
  };
  CHECK(
      refusal("0 90 1 0", Board::isk) ==
      "x.cfg:9: frameCfg requests a frame every 90 ms, but a frame of 8832 bytes takes 95.8 ms at "
      "921600 baud; "
      "with a heat map the firmware then sends nothing: use a longer period, fewer bins or "
      "no heat map");
  CHECK_THAT(refusal("0 100 1 0", Board::aop),
             Catch::Contains("frameCfg requests a frame every 100 ms"));
  CHECK(warnings("0 100 1 0", "0 150 1 0", Board::aop).empty());
  CHECK_THAT(warnings("channelCfg 15 7", "channelCfg 7 5", Board::isk).at(0),
             Catch::StartsWith("x.cfg:4: channelCfg has fewer than 4 receivers"));
  // Transmitter 2 is used before transmitter 3.
  const std::string other = "chirpCfg 1 1 0 0 0 0 0 2\r\nchirpCfg 2 2 0 0 0 0 0 4\r\n";
  const std::string usual = "chirpCfg 1 1 0 0 0 0 0 4\r\nchirpCfg 2 2 0 0 0 0 0 2\r\n";
  CHECK_THAT(warnings(usual, other, Board::isk).at(0),
             Catch::StartsWith("x.cfg:8: chirpCfg uses transmitter 2 before 3"));
  // Sending a 12.9 kB frame takes more than 100 ms.
  CHECK_THAT(refusal("0 100 1 0", Board::ods), Catch::Contains("takes"));
}

TEST_CASE("the installed radar cfgs give the expected antennas and frame sizes without warnings") {
  for (const char* name :
       {"xwr68xx_azimuth_50cm", "xwr68xx_azimuth_44mm", "xwr68xx_44mm", "xwr68xx_paper_50cm",
        "xwr64xx_aop_50cm", "xwr64xx_aop_44mm", "xwr64xx_aop_azimuth_88mm", "xwr64xx_ods_50cm",
        "xwr64xx_ods_44mm", "xwr64xx_ods_azimuth_88mm"})
    for (const char* sdk : {".cfg", "_sdk3.4.cfg"}) {
      const std::string text = contents(source_dir + "/config/radar/" + name + sdk);
      CAPTURE(name, sdk);
      const auto is = [&](const char* part) { return has(name, part); };
      const Board board = is("aop") ? Board::aop : is("ods") ? Board::ods : Board::isk;
      const RadarProfile p = parse_profile(text, name, 921600, board);
      CHECK(p.warnings.empty());
      const std::size_t antennas = is("azimuth") && board == Board::isk ? 8 : 12;
      CHECK(p.array.size() == (is("azimuth") ? antennas : 0));
      CHECK(p.antennas == antennas);
      if (is("azimuth"))
        CHECK(p.frame_bytes == (p.bins == 64 ? 2304 : p.bins == 128 ? 6528 : 8832));
    }
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
  for (const auto& [from, to] : std::vector<std::pair<std::string, std::string>>{
           // Only the slope, only the number of samples or only the number of antennas differs.
           {"18.75 1 60 2000 0 0 30\nchirp", "15 1 60 2000 0 0 30\nchirp"},
           {"1 60 2000 0 0 30\nchirp", "1 64 2000 0 0 30\nchirp"},
           {"subFrameCfg 3 0 9 3", "subFrameCfg 3 0 9 2"}})
    CHECK(refusal(changed(from, to)) ==
          "x.cfg:33: subFrameCfg has a different range axis or different antennas than subframe 0; "
          "a record is the mean of all subframes");
  CHECK(parse_profile(changed("guiMonitor -1", "guiMonitor 2"), "x.cfg").refusals.at(0) ==
        "x.cfg:52: sensorStart requires guiMonitor for subframe 0 before it");
  const auto each_gui = [](const char* other) {
    return changed("guiMonitor -1 0 1 0 0 0 1",
                   std::string("guiMonitor 0 0 1 0 0 0 1\nguiMonitor 1 0 1 0 0 0 1\n"
                               "guiMonitor 2 0 1 0 0 0 1\nguiMonitor 3 0 ") +
                       other);
  };
  CHECK(parse_profile(each_gui("1 0 0 0 1"), "x.cfg").refusals.empty());
  CHECK(refusal(each_gui("0 0 0 0 1")) ==
        "x.cfg:34: guiMonitor requests other data than the last guiMonitor; a record is the mean "
        "of all subframes");
  CHECK(refusal(changed("subFrameCfg 2 0", "subFrameCfg 1 0")) ==
        "x.cfg:29: advFrameCfg has no subFrameCfg 2");
  CHECK(refusal(changed("advFrameCfg 4", "% advFrameCfg 4")) ==
        "x.cfg:30: subFrameCfg requires advFrameCfg before it");
}

TEST_CASE("radar codes are converted to power, and doubling the magnitude adds 6.02 dB") {
  CHECK(power_from_code(256, 8) == Approx(4.0));
  // TI's firmware sends the sum of 256 log2 |x| over 12 antennas, divided by 16. For |x| = 2, the
  // code is therefore 256 * 12 / 16.
  CHECK(power_from_code(256 * 3 / 4, 12) == Approx(4.0));
  CHECK(power_from_code(0, 12) == 1);
  // The SDK multiplies a CFAR threshold in dB by 256/6 * antennas / 2^ceil(log2 antennas) to obtain
  // a code. A power of 1e6 corresponds to 60 dB.
  CHECK(power_from_code(60 * 256 * 12 / 16 / 6, 12) == Approx(1e6).epsilon(0.06));
  CHECK(power_from_code(65535, 1) == std::exp2(127.f));
}

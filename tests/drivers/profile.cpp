// SPDX-License-Identifier: MIT

#include "../fixtures/folder.hpp"
#include "../fixtures/shell.hpp"
#include "drivers/radar/log2_codes.hpp"
#include "drivers/util/format.hpp"
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
}

TEST_CASE("the end frequency of a chirp is computed in register steps of the radar chip") {
  const std::string profile = "0 60 7 3 24 0 0 166 1 256 12500 0 0 30";
  const RadarProfile p =
      parse_profile(with(profile, "0 60 84 7 88.89 0 0 45 1 176 2175 0 0 158"), "x.cfg");
  CHECK(p.refusals.empty());
  CHECK(p.carrier_hz == Approx(60e9 + 44.9724e12 * (7 + 0.5 * 176 / 2.175) * 1e-6).epsilon(1e-6));
  // Tests sweeps over the full bandwidth. The values are rounded as in TI's tool.
  for (int slope = 20; slope <= 250; ++slope) {
    const auto text = format("0 60 7 3 %.2f 0 0 %d 1 16 12500 0 0 30", 4e3 / slope, slope);
    CHECK(parse_profile(with(profile, text), "x.cfg").refusals.empty());
  }
  CHECK(parse_profile(with(profile, "0 60 84 7 88.89 0 0 45.04 1 176 2175 0 0 158"), "x.cfg")
            .refusals.at(0) ==
        "x.cfg:5: profileCfg sweeps 60 to 64.0008 GHz (limits 60 to 64 GHz)");
}

TEST_CASE("radar cfg lines are sent unchanged except for CR, blank lines and comments") {
  std::string lines;
  for (const CfgLine& line : command_lines("a  b \r\n\r\n% c\n  % d\n  e\n\nf"))
    lines += std::to_string(line.number) + ":" + line.text + "\n";
  CHECK(lines == "1:a  b \n5:  e\n7:f\n");
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

// SPDX-License-Identifier: MIT
// Compares the table of radar commands with the simulated firmware, which has its own limits.
#include "drivers/radar/demo_commands.hpp"

#include "../fixtures/error.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/paths.hpp"
#include "drivers/radar/profile.hpp"
#include "sim/devices/radar_firmware.hpp"

TEST_CASE("the table of radar commands and the simulated firmware refuse the same cfgs") {
  const std::string right =
      test::contents(test::source_dir + "/config/radar/xwr68xx_paper_50cm.cfg");
  // Lines of the cfg and their replacements. An empty replacement deletes the line.
  using Changes = std::vector<std::pair<std::string, std::vector<std::string>>>;
  Changes accepted{
      {"% SPDX", {"% a comment"}},
      {"flushCfg", {"% no flushCfg"}},
      {"lowPower 0 0", {""}},
      {"CQRxSatMonitor 0 3 4 29 0", {""}},
      {"CQSigImgMonitor 0 29 2", {""}},
      {"0 18.75 1 60 2000 0 0 30", {"0 18.75 1 60 2000 3 3 180", "0 18.75 1 64 2000 0 0 158"}},
      // The chip rounds these ramps to below 64 GHz.
      {"0 60 7 6 40 0 0 18.75 1 60 2000 0 0 30",
       {"0 60 84 7 88.89 0 0 45 1 176 2175 0 0 158", "0 60 84 7 66.67 0 0 60 1 256 4363 0 0 158"}},
      {"frameCfg 0 2 32 0 50", {"frameCfg 0 2 244 0 100", "frameCfg 0 2 32 0 1342"}},
      {"frameCfg 0 2 32 0 50 1 0", {"frameCfg 0 1 32 65535 50 2 0.01"}},
      {"chirpCfg 2 2 0",
       {"profileCfg 3 61 7 6 40 0 0 18 1 64 2000 0 0 30\nchirpCfg 2 2 0",
        "chirpCfg 3 511 0 0 0 0 0 7\nchirpCfg 2 2 0"}},
      {"chirpCfg 2 2 0 0 0 0 0 4", {"chirpCfg 2 2 0 337500000 36 40.95 0 4"}},
      {"chirpCfg 0 0 0", {"chirpCfg 0 1 0"}},
      {"calibData 0 0 0", {"calibData 1 0 0x1F0000"}},
      {"lvdsStreamCfg -1 0 0 0", {"lvdsStreamCfg 0 1 1 1"}},
      {"calibDcRangeSig -1 0 -5 8 256", {"calibDcRangeSig 0 1 -16 15 64"}},
      {"cfarFovCfg -1 1 -1 1.00", {"cfarFovCfg 0 1 -3.2 3.2"}},
      {"guiMonitor -1 0", {"guiMonitor -1 2"}}};
  Changes refused{
      {"profileCfg 0", {"profileCfg 4"}},
      {"0 60 7 6 40",
       {"0 60 5243 6 40", "0 60 7 41 100", "0 60 7 6 5001", "0 59.9 7 6 40", "0 63.9 7 6 40"}},
      {"18.75 1 60 2000",
       {"-18.75 1 60 2000", "251 1 60 2000", "18.75 41 60 2000", "18.75 1 1 2000",
        "18.75 1 1025 37500", "18.75 1 60 1999", "18.75 1 60 12501"}},
      {"2000 0 0 30", {"2000 4 0 30", "2000 0 4 30", "2000 0 0 300", "2e3 0 0 30"}},
      {"chirpCfg 2 2 0",
       {"chirpCfg 2 1 0", "chirpCfg 2 3 0",
        "profileCfg 3 61 7 6 40 0 0 18.75 1 60 2000 0 0 30\nchirpCfg 2 2 3", "chirpCfg 2 512 0",
        "chirpCfg 3 3 0 3500000000 0 0 0 1\nchirpCfg 2 2 0", "chirpCfg 2 2 1"}},
      {"chirpCfg 2 2 0 0 0 0 0 4",
       {"chirpCfg 2 2 0 0 0 0 0 5", "chirpCfg 2 2 0 0 0 0 0 8", "chirpCfg 2 2 0 0 0 41 0 4",
        "chirpCfg 2 2 0 400000000 0 0 0 4", "chirpCfg 2 2 0 0 2300 0 0 4"}},
      {"frameCfg 0 2 32",
       {"frameCfg 2 0 32", "frameCfg 0 512 32", "frameCfg 0 3 32", "frameCfg 0 2 0"}},
      {"frameCfg 0 2 32 0 50",
       {"frameCfg 0 2 256 0 1000", "frameCfg 0 2 32 0 0.2", "frameCfg 0 2 32 0 1343",
        "frameCfg 0 2 32 0 4"}},
      {"frameCfg 0 2 32 0", {"frameCfg 0 2 32 65536"}},
      {"frameCfg 0 2 32 0 50 1", {"frameCfg 0 2 32 0 50 3", "frameCfg 0 2 32 0 50 0"}},
      {"chirpCfg 2 2 0 0 0 0 0 4\nframeCfg 0 2 32", {"chirpCfg 2 40 0 0 0 0 0 4\nframeCfg 0 40 4"}},
      {"40 0 0 18.75 1 60 2000", {"100 0 0 18.75 1 1024 12500"}},
      {"dfeDataOutputMode 1",
       {"dfeDataOutputMode 2", "dfeDataOutputMode 3", "dfeDataOutputMode 4"}},
      {"channelCfg 15 7 0",
       {"channelCfg 16 7 0", "channelCfg 0xF 7 0", "channelCfg 15 5 0", "channelCfg 0 7 0",
        "channelCfg 15 8 0", "channelCfg 15 7 1", "channelCfg 15 7"}},
      {"adcCfg 2 1", {"adcCfg 1 1", "adcCfg 2 0", "adcCfg 2 3"}},
      {"adcbufCfg -1 0 1 1 1",
       {"adcbufCfg -1 1 1 1 1", "adcbufCfg -1 0 1 0 1", "adcbufCfg -1 0 1 1 2",
        "adcbufCfg 4 0 1 1 1"}},
      {"guiMonitor -1 0", {"guiMonitor 4 0", "guiMonitor 1 0", "guiMonitor -1 3"}},
      {"cfarCfg -1 0 2", {"cfarCfg 3 0 2", "cfarCfg -1 0 3", "cfarCfg -1 1 2", "cfarCfg -1 2 2"}},
      {"guiMonitor -1 0 1 0 0 0 1", {"guiMonitor -1 0 1 0 0 0 2"}},
      {"3 1 15.0 0", {"3 1 100.5 0", "3 2 15 0"}},
      {"multiObjBeamForming -1 1 0.5",
       {"multiObjBeamForming -1 2 0.5", "multiObjBeamForming -1 1 1.5"}},
      {"calibDcRangeSig -1 0 -5 8 256",
       {"calibDcRangeSig -1 0 5 8 256", "calibDcRangeSig -1 0 -20 20 256",
        "calibDcRangeSig -1 0 -5 8 250"}},
      {"clutterRemoval -1 0", {"clutterRemoval -1 2"}},
      {"Phase 0.0 1", {"Phase 0.0 1.5"}},
      {"Phase 0.0 1 0", {"Phase 0.0 1"}},
      {"measureRangeBiasAndRxChanPhase 0", {"measureRangeBiasAndRxChanPhase 2"}},
      {"aoaFovCfg -1 -90", {"aoaFovCfg -1 -91"}},
      {"aoaFovCfg -1 -90 90", {"aoaFovCfg -1 90 -90"}},
      {"cfarFovCfg -1 0 0 14", {"cfarFovCfg -1 0 14 0"}},
      {"extendedMaxVelocity -1 0", {"extendedMaxVelocity -1 2"}},
      {"CQRxSatMonitor 0", {"CQRxSatMonitor 4"}},
      {"CQSigImgMonitor 0", {"CQSigImgMonitor 4"}},
      {"analogMonitor 0 0", {"analogMonitor 2 0"}},
      {"lvdsStreamCfg -1 0 0 0", {"lvdsStreamCfg -1 0 5 0", "lvdsStreamCfg -1 0 1 1"}},
      {"bpmCfg -1 0 0 1", {"bpmCfg -1 2 0 1"}},
      {"calibData 0 0 0", {"calibData 2 0 0", "calibData 1 1 0"}},
      {"sensorStart", {"myCfg 1\nsensorStart", "flushCfg\nsensorStart"}},
      {"adcbufCfg", {"flushCfg\nadcbufCfg", "% adcbufCfg"}},
      {"% SPDX", {"sensorStart\n% SPDX"}}};
  for (const char* needed :
       {"dfeDataOutputMode 1", "channelCfg 15 7 0", "adcCfg 2 1", "adcbufCfg -1 0 1 1 1",
        "profileCfg 0 60 7 6 40 0 0 18.75 1 60 2000 0 0 30", "chirpCfg 0 0 0 0 0 0 0 1",
        "frameCfg 0 2 32 0 50 1 0", "guiMonitor -1 0 1 0 0 0 1", "cfarCfg -1 0 2 8 4 3 0 15.0 0",
        "cfarFovCfg -1 1 -1 1.00", "multiObjBeamForming -1 1 0.5", "calibDcRangeSig -1 0 -5 8 256",
        "clutterRemoval -1 0", "aoaFovCfg -1 -90 90 -90 90", "extendedMaxVelocity -1 0",
        "analogMonitor 0 0", "lvdsStreamCfg -1 0 0 0"}) {
    refused.push_back({std::string(needed) + '\n', {""}});
    refused.push_back({"sensorStart", {"sensorStart\n" + std::string(needed) + "\n#" + needed}});
  }
  const auto check = [&](const std::string& from, const std::string& to, bool fits) {
    std::string text = right;
    const std::size_t at = text.find('\n' + from) + 1;
    const std::size_t begin = at ? at : text.find(from);
    REQUIRE(begin != text.npos);
    text.replace(begin, from.size(), to);
    // A replacement "...#line" moves the line: its first occurrence is deleted.
    if (const std::size_t mark = to.find('#'); mark != to.npos) {
      const std::string moved = to.substr(mark + 1);
      text.erase(text.find('#' + moved), moved.size() + 1);
      text.erase(text.find('\n' + moved), moved.size() + 1);
    }
    std::string why;
    const std::string thrown = test::refusal_by([&] {
      for (const auto& line : radar::parse_profile(text, "x.cfg").refusals) why += line + '\n';
    });
    why += thrown;
    std::string said;
    sim::RadarFirmware board([&](const std::string& reply) { said += reply; },
                             [](const std::string&) {});
    for (const auto& line : radar::command_lines(text)) {
      const std::string sent = line.text + '\n';
      board.receive({reinterpret_cast<const std::uint8_t*>(sent.data()), sent.size()});
    }
    const bool firmware = board.running() && said.find("Error") == said.npos &&
                          said.find("not recognized") == said.npos;
    INFO(from << " -> " << to << ": " << why);
    CHECK(why.empty() == fits);
    CHECK(firmware == fits);
  };
  for (const bool fits : {true, false})
    for (const auto& [from, replacements] : fits ? accepted : refused)
      for (const std::string& to : replacements) check(from, to, fits);
}

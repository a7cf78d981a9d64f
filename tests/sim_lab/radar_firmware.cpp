// SPDX-License-Identifier: MIT
// Tests the command dialogue of the simulated firmware with transcripts of host and firmware.
#include "sim/devices/radar_firmware.hpp"

#include "../fixtures/folder.hpp"
#include "../fixtures/paths.hpp"
#include "drivers/radar/command_dialogue.hpp"
#include "drivers/radar/log2_codes.hpp"

using namespace echofuse::sim;

namespace {

class Console {
 public:
  explicit Console(unsigned sdk = 5, RadarDemo demo = RadarDemo::dsp)
      : firmware_([this](const std::string& text) { said_ += text; },
                  [this](const std::string& raw) { data_ += raw; }, sdk, demo) {}

  RadarFirmware& firmware() { return firmware_; }
  // Sends bytes to the firmware and returns its answer.
  std::string send(const std::string& text) {
    said_.clear();
    firmware_.receive({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
    return said_;
  }
  const std::string& said() const { return said_; }
  const std::string& data() const { return data_; }

 private:
  std::string said_, data_;
  RadarFirmware firmware_;
};

const std::string cfg_folder = test::source_dir + "/config/radar/";

// Sends a cfg, leaving out the last line (sensorStart) and all lines that begin with `without`.
void configure(Console& console, const std::string& without = "none",
               const std::string& name = "xwr68xx_paper_50cm.cfg") {
  std::istringstream lines(test::contents(cfg_folder + name));
  for (std::string line; std::getline(lines, line) && line != "sensorStart";) {
    if (line.starts_with(without)) continue;
    const std::string reply = console.send(line + "\n");
    const std::string ending = line[0] == '%' ? "Skipped\n\rmmwDemo:/>" : "Done\n\rmmwDemo:/>";
    INFO(line << " -> " << reply);
    REQUIRE(reply.size() >= ending.size());
    REQUIRE(reply.substr(reply.size() - ending.size()) == ending);
  }
}

void start_and_stop(Console& console) {
  configure(console);
  console.send("sensorStart\n");
  console.send("sensorStop\n");
  console.firmware().between_frames();
}

}  // namespace

TEST_CASE("simulated radar firmware sends a banner and a prompt at power-up") {
  Console console;
  console.firmware().boot();
  CHECK(console.said() ==
        "******************************************\n\r"
        "xWR68xx MMW Demo 03.05.00.04\n\r"
        "******************************************\n\r"
        "mmwDemo:/>");
}

TEST_CASE("simulated radar firmware answers a command with an echo, a reply and a prompt") {
  Console console;
  const std::string unknown = "is not recognized as a CLI command\n\r",
                    ignored =
                        "Ignored: noise profile and Doppler heat map are not simulated\n\r"
                        "Done\n\r";
  // The firmware echoes a carriage return twice and treats it as a line feed, so CR LF causes a
  // second prompt. A tab does not separate words.
  for (const auto& [sent, reply] :
       {std::pair<std::string, std::string>{"\n", ""},
        {"flushCfg\n", "Done\n\r"},
        {"guiMonitor -1 0 1 1 0 0 1\n", ignored},
        {"guiMonitor -1 0 1 0 0 1 1\n", ignored},
        {"guiMonitor -1 1 1 0 1 0 1\n", "Done\n\r"},
        {"flushCfg\r\n", "Done\n\rmmwDemo:/>\n"},
        {"% a comment\n", "Skipped\n\r"},
        {"sensorSTART\n", "'sensorSTART' " + unknown},
        {"\tsensorStop\n", "'\tsensorStop' " + unknown},
        {"frameCfg\t0 2 32 0 50 1 0\n", "'frameCfg\t0' " + unknown},
        {"frameCfg 0 2\n",
         "Error: Invalid usage of the CLI command\n\r"
         "Error -1\n\r"},
        {"sensorStop\n", "Ignored: Sensor is already stopped\n\rDone\n\r"},
        {"queryDemoStatus\n",
         "Sensor State: 0\n\rData port baud rate: "
         "921600\n\rDone\n\r"}})
    CHECK(console.send(sent) == sent + reply + "mmwDemo:/>");
}

TEST_CASE("simulated radar firmware splits command lines after 255 characters") {
  Console console;
  const std::string long_line = "% " + std::string(300, 'x') + "\n";
  const std::string reply = console.send(long_line);
  CHECK(reply.substr(0, 255) == long_line.substr(0, 255));
  CHECK(reply.substr(255, 18) == "Skipped\n\rmmwDemo:/");
  CHECK_THAT(reply, Catch::EndsWith("is not recognized as a CLI command\n\rmmwDemo:/>"));
}

TEST_CASE("simulated radar subframes start one after another, each with its own profile") {
  Console console;
  configure(console, "none", "../../tests/drivers/four_subframes.cfg");
  CHECK(console.send("sensorStart\n") == "sensorStart\nDone\n\rmmwDemo:/>");
  const auto& subframes = console.firmware().subframes();
  REQUIRE(subframes.size() == 4);
  for (std::size_t k = 0; k < 4; ++k) {
    CHECK(subframes[k].start_ghz == Approx(60 + 1.08 * static_cast<double>(k)));
    CHECK(subframes[k].antennas == 12);
    CHECK(subframes[k].frame_period_ms == 12.5);
    CHECK(subframes[k].axis({}).step_m == Approx(0.2502210254));
  }
  Console other;
  configure(other, "subFrameCfg 3", "../../tests/drivers/four_subframes.cfg");
  CHECK_THAT(other.send("sensorStart\n"), Catch::Contains("Error -1"));
}

TEST_CASE("a complete cfg starts the simulated radar and defines its range axis") {
  // The chip rounds a slope of 18.75 MHz/us to 517 steps of 36.21 kHz/us each. The slope of the
  // other cfg is rounded to 4584 steps.
  for (const auto& [name, bins, step_m] : {std::tuple{"xwr68xx_paper_50cm.cfg", 64u, 0.2502210254},
                                           {"xwr68xx_44mm.cfg", 256u, 0.0440950}}) {
    Console console;
    configure(console, "none", name);
    CHECK(console.send("sensorStart\n") == "sensorStart\nDone\n\rmmwDemo:/>");
    const Chirp& chirp = console.firmware().running().value();
    const RadarAxis axis = chirp.axis({});
    CHECK(axis.count == bins);
    CHECK(axis.step_m == Approx(step_m).epsilon(1e-6));
    CHECK(axis.resolution_m == Approx(bins * axis.step_m / chirp.samples).epsilon(1e-12));
    CHECK(chirp.antennas == 12);
    const RadarOutputs& outputs = console.firmware().outputs();
    CHECK((outputs.range_profile && outputs.stats && !outputs.objects && !outputs.heat_map));
    if (bins == 64) CHECK(chirp.firmware_step_m() == 0.25);
  }
}

TEST_CASE("the simulated radar starts, stops and restarts on command") {
  Console console;
  configure(console);
  console.send("sensorStart\n");
  CHECK(console.send("sensorStart\n") ==
        "sensorStart\nIgnored: Sensor is already started\n\rDone\n\rmmwDemo:/>");
  CHECK(console.send("bpmCfg -1 0 0 1\n") ==
        "bpmCfg -1 0 0 1\nIgnored: This command is not allowed after sensor has started\n\r"
        "Done\n\rmmwDemo:/>");

  // sensorStop takes effect at the end of the frame. Any input received before the end is lost.
  CHECK(console.send("sensorStop\n") == "sensorStop\n");
  CHECK(console.send("version\n").empty());
  console.firmware().between_frames();
  CHECK(console.said() == "Done\n\rmmwDemo:/>");
  CHECK_FALSE(console.firmware().running());

  CHECK_THAT(console.send("sensorStart\n"), Catch::Contains("provided no configuration"));
  CHECK_THAT(console.send("sensorStart 1\n"), Catch::Contains("Reconfig is not supported"));
  CHECK(console.send("sensorStart 0\n") == "sensorStart 0\nDone\n\rmmwDemo:/>");
  CHECK(console.firmware().running());
}

TEST_CASE("simulated radar firmware refuses a partial cfg between stop and start") {
  Console console;
  start_and_stop(console);
  console.send("clutterRemoval -1 1\n");
  for (const char* start : {"sensorStart\n", "sensorStart 0\n"})
    CHECK_THAT(console.send(start), Catch::Contains("partial configuration between stop"));
  configure(console);
  CHECK_THAT(console.send("sensorStart 0\n"), Catch::Contains("complete new configuration"));
  CHECK(console.send("sensorStart\n") == "sensorStart\nDone\n\rmmwDemo:/>");
}

TEST_CASE("changing the antennas after the first start crashes the simulated radar firmware") {
  Console console;
  start_and_stop(console);
  configure(console);
  console.send("channelCfg 15 5 0\n");
  CHECK_THAT(console.send("sensorStart\n"), Catch::Contains("Exception: "));
  CHECK(console.send("version\n").empty());
}

TEST_CASE("the simulated radar data port changes its baud rate and sends a ping") {
  Console console;
  CHECK(console.send("configDataPort 460800 1\n") ==
        "configDataPort 460800 1\nData port baud rate changed to 460800\n\rDone\n\rmmwDemo:/>");
  CHECK(console.data() == std::string(16, '\xff'));
  CHECK(console.firmware().data_baud() == 460800);
  CHECK_THAT(console.send("configDataPort 4000000 0\n"), Catch::Contains("Ignored: Invalid baud"));
}

TEST_CASE("simulated range profile codes of a strong echo and of noise match the expected power") {
  Conditions c;
  c.radar_snr_db = 60;
  Rng rng(5);
  const double mean_peak = 0.5;
  std::vector<double> power(4000, 0.0);
  // The magnitude of the echo is 2^19, so the code is 256 * 19 * 12 / 16.
  power[0] = 0.25;
  const auto codes = range_profile_codes(power, mean_peak, 12, c, rng);
  CHECK(std::abs(codes[0] - 3648) <= 1);
  // The expected noise consists of the noise common to a frame, which is exponentially distributed,
  // and a small part of the noise of each antenna. The mean over n frames then has the noise of a
  // simulated data set, rms / sqrt(n).
  double mean = 0, squares = 0;
  for (std::size_t i = 1; i < codes.size(); ++i) {
    const double noise = radar::power_from_code(codes[i], 12) / std::pow(radar_gain, 2);
    mean += noise / 3999, squares += noise * noise / 3999;
  }
  const double own = radar_noise_power(c, mean_peak), rms = profile_noise(c, mean_peak, 1);
  CHECK(std::abs(mean - rms - own / 2) < own / 2 + 5 * rms / std::sqrt(3999.0));
  const double variance = squares - mean * mean;
  CHECK(std::abs(variance - rms * rms) < 0.05 * rms * rms + 5 * std::sqrt(8 / 3999.0) * rms * rms);
}

TEST_CASE("simulated radar firmware measures the range bias with a parabola through the peak") {
  std::vector<double> power(40, 1e-6);
  // The magnitudes lie on a parabola with its peak at bin 10.3.
  for (const int i : {9, 10, 11})
    power[static_cast<std::size_t>(i)] = std::pow(5 - std::pow(i - 10.3, 2), 2);
  CHECK(measured_range_bias_m(power, 0.1, 1.0, 0.2) == Approx(0.03).margin(1e-9));
}

namespace {

// Runs the command dialogue against simulated firmware that answers immediately. Returns the error
// message, or an empty string if there is no error.
std::string failure_of(const std::string& name, unsigned sdk, RadarDemo demo) {
  const std::string text = test::contents(cfg_folder + name);
  radar::CommandDialogue dialogue(text, name);
  Console board(sdk, demo);
  board.firmware().boot();
  HostTime now{};
  dialogue.start(now);
  const auto tell = [&](const std::string& said) {
    dialogue.receive({reinterpret_cast<const std::uint8_t*>(said.data()), said.size()}, now);
  };
  tell(board.said());
  while (dialogue.deadline()) {
    const std::string out = dialogue.take_output();
    if (out.empty())
      now = *dialogue.deadline(), dialogue.tick(now);
    else
      tell(board.send(out));
  }
  return dialogue.failure();
}

}  // namespace

TEST_CASE(
    "each simulated radar board accepts only cfgs for that board, and errors name the right file") {
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(cfg_folder)) {
    const std::string name = entry.path().filename();
    ++files;
    for (const unsigned sdk : {4u, 5u, 6u})
      for (const RadarDemo demo : {RadarDemo::dsp, RadarDemo::accelerator}) {
        const bool for_old = name.find("sdk3.4") != name.npos, of_isk = name.starts_with("xwr68xx");
        const std::string failure = failure_of(name, sdk, demo);
        CAPTURE(name, sdk, demo == RadarDemo::dsp, failure);
        const bool right_demo = of_isk == (demo == RadarDemo::dsp),
                   right_sdk = for_old == (sdk == 4);
        CHECK(failure.empty() == (right_demo && right_sdk));
        if (!right_demo && of_isk)
          CHECK_THAT(
              failure,
              Catch::Contains("bpmCfg") &&
                  Catch::Contains("the board runs the hardware-accelerator demo (AOP, ODS): use "
                                  "config/radar/xwr64xx_aop"));
        else if (!right_demo && right_sdk)
          CHECK_THAT(failure, Catch::Contains("cfg for the hardware-accelerator demo") &&
                                  Catch::Contains("Then use config/radar/xwr68xx_"));
        else if (!right_sdk && right_demo)
          CHECK_THAT(failure, Catch::Contains("use a cfg for SDK 3."));
        // Each file suggested by the error message must exist.
        if (const auto at = failure.find("config/radar/"); at != failure.npos) {
          const std::string other = failure.substr(at, failure.find_first_of(" ,;", at) - at);
          CHECK(std::filesystem::exists(test::source_dir + "/" + other));
        }
      }
  }
  CHECK(files == 20);
}

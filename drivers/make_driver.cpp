// SPDX-License-Identifier: MIT
#include "drivers/make_driver.hpp"

#include <variant>

#include "drivers/bridge/bridge_driver.hpp"
#include "drivers/depth/openni_camera.hpp"
#include "drivers/inventory/inventory.hpp"
#include "drivers/port/loop.hpp"
#include "drivers/port/open_port.hpp"
#include "drivers/port/raw_tap.hpp"
#include "drivers/radar/radar_driver.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse {
namespace {

[[noreturn]] void refuse(const std::string& address, const std::string& why) {
  throw Error(ExitCode::config, "address \"" + address + "\": " + why);
}

template <class... Kinds>
bool is_one_of(const port::Address& address) {
  return (std::holds_alternative<Kinds>(address) || ...);
}

template <class Config>
struct Kind {
  const char* scheme;  // beginning of the address
  const char* syntax;
  std::unique_ptr<Driver> (*make)(port::Loop&, const Config&, port::RawKeeper*);
};

template <Sensor sensor, class Config>
std::unique_ptr<Driver> bridge_driver(port::Loop& loop, const Config& config,
                                      port::RawKeeper* raw) {
  return std::make_unique<bridge::BridgeDriver>(
      sensor, loop, config.address,
      port::tap(loop, loop.opener(config.address), raw,
                sensor == Sensor::spd ? "tags" : name_of(sensor), ".blocks"));
}

std::unique_ptr<Driver> openni(port::Loop& loop, const DepthConfig& config, port::RawKeeper* raw) {
  return std::make_unique<depth::OpenNiCamera>(
      loop, config.address, std::get<port::OpenNiAddress>(port::parse_address(config.address)).uri,
      depth::OpenNiOptions{.width = config.width, .height = config.height, .fps = config.fps}, raw);
}

// To add a driver, add its source file to the folder of its sensor and a row to one of these lists.
constexpr Kind<TdcConfig> taggers[] = {
    {"bridge:", "bridge:tcp://HOST:PORT", bridge_driver<Sensor::spd>},
    {"usb:", "usb:VVVV:PPPP", bridge_driver<Sensor::spd>},
};
constexpr Kind<RadarConfig> radars[] = {
    {"bridge:", "bridge:tcp://HOST:PORT", bridge_driver<Sensor::radar>},
};
constexpr Kind<DepthConfig> cameras[] = {
    {"openni:", "openni:[URI or file.oni]", openni},
    {"bridge:", "bridge:tcp://HOST:PORT", bridge_driver<Sensor::depth>},
};

template <class Kinds>
const auto& kind_of(const Kinds& kinds, const std::string& address, const std::string& device,
                    const char* advice = "") {
  port::parse_address(address);
  std::string known;
  for (const auto& kind : kinds) {
    if (address.starts_with(kind.scheme)) return kind;
    known += (known.empty() ? "" : " or ") + std::string(kind.syntax);
  }
  refuse(address, "expected the address of a " + device + ": " + known + advice);
}

const auto& tagger_of(const std::string& address) {
  return kind_of(taggers, address, "time tagger");
}
const auto& radar_of(const std::string& address) {
  return kind_of(radars, address, "radar",
                 "; for a radar without a bridge set radar.cli and radar.data instead");
}
const auto& camera_of(const std::string& address) {
  return kind_of(cameras, address, "depth camera");
}

}  // namespace

void check_tdc(const std::string& address) { tagger_of(address); }
void check_radar(const std::string& address) { radar_of(address); }
void check_depth(const std::string& address) { camera_of(address); }

void check_radar_port(const std::string& address, std::uint32_t baud) {
  const port::Address parsed = port::parse_address(address);
  if (!is_one_of<port::SerialAddress, port::HidAddress>(parsed))
    refuse(address, "expected the address of a radar port: serial:/dev/... or hid:VVVV:PPPP");
  if (const auto* hid = std::get_if<port::HidAddress>(&parsed)) port::check_hid_baud(*hid, baud);
}

std::unique_ptr<Driver> make_tdc(port::Loop& loop, const TdcConfig& config, port::RawKeeper* raw) {
  return tagger_of(config.address).make(loop, config, raw);
}

std::unique_ptr<Driver> make_depth(port::Loop& loop, const DepthConfig& config,
                                   port::RawKeeper* raw) {
  return camera_of(config.address).make(loop, config, raw);
}

namespace {

// Returns a warning for each port that is known to have the opposite role (command or data). Does
// not open the ports.
std::vector<std::string> radar_warnings(const RadarConfig& config) {
  using inventory::RadarPort;
  const auto is = [](const std::string& text, RadarPort expected) {
    const port::Address address = port::parse_address(text);
    const auto* serial = std::get_if<port::SerialAddress>(&address);
    return serial && inventory::radar_port(serial->path) == expected;
  };
  std::vector<std::string> out;
  if (is(config.cli, RadarPort::data))
    out.push_back("radar.cli = \"" + config.cli +
                  "\" is the board's data port; are radar.cli and radar.data swapped?");
  if (is(config.data, RadarPort::command))
    out.push_back("radar.data = \"" + config.data +
                  "\" is the board's command port; are radar.cli and radar.data swapped?");
  return out;
}

void refuse_two_boards(const RadarConfig& config) {
  const port::Address cli = port::parse_address(config.cli),
                      data = port::parse_address(config.data);
  const auto *command = std::get_if<port::SerialAddress>(&cli),
             *frames = std::get_if<port::SerialAddress>(&data);
  if (!command || !frames) return;
  const std::string boards = inventory::two_boards(command->path, frames->path);
  if (!boards.empty())
    throw Error(ExitCode::config,
                "radar.cli and radar.data are ports of two different boards: " + boards);
}

}  // namespace

std::unique_ptr<Driver> make_radar(port::Loop& loop, const RadarConfig& config,
                                   port::RawKeeper* raw) {
  if (!config.address.empty()) return radar_of(config.address).make(loop, config, raw);
  check_radar_port(config.cli, config.cli_baud);
  check_radar_port(config.data, config.data_baud);
  refuse_two_boards(config);
  return std::make_unique<radar::RadarDriver>(
      loop, radar::RadarSetup{.address = config.cli + " " + config.data,
                              .cli = port::tap(loop, loop.opener(config.cli, config.cli_baud), raw,
                                               "radar-cli", ".txt"),
                              .data = port::tap(loop, loop.opener(config.data, config.data_baud),
                                                raw, "radar", ".dat"),
                              .cfg_text = config.cfg_text,
                              .cfg_name = config.cfg_name,
                              .warnings = radar_warnings(config),
                              .data_baud = config.data_baud,
                              .board = radar::board_named(config.board).value_or(radar::Board::isk),
                              .keep_running = config.keep_running});
}

}  // namespace echofuse

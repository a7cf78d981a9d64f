// SPDX-License-Identifier: MIT
#include "acquire/devices.hpp"

#include <boost/asio/io_context.hpp>
#include <cinttypes>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

#include "acquire/attached.hpp"
#include "drivers/core/console.hpp"

namespace echofuse::acquire {
namespace {

// For whoever only wants to know what answers.
class NullSink final : public SampleSink {
  void on_tags(const TagBlock&) override {}
  void on_radar(RadarFrame) override {}
  void on_depth(DepthFrame) override {}
  void on_state(Sensor, DeviceState, const DeviceInfo&) override {}
  void on_event(Sensor, Severity, const std::string&) override {}
};

std::string address_of(const Config& config, Sensor s) {
  if (s == Sensor::spd) return config.tdc.address;
  return s == Sensor::radar ? config.radar.cli : config.depth.address;
}

nlohmann::ordered_json to_json(Sensor s, const Devices::Seen& seen) {
  return {{"sensor", name_of(s)},           {"address", seen.info.address},
          {"state", name_of(seen.state)},   {"answers", seen.delivers()},
          {"model", seen.info.model},       {"serial", seen.info.serial},
          {"firmware", seen.info.firmware}, {"samples", seen.samples},
          {"last_event", seen.last_event}};
}

void print_device(Sensor s, const Devices::Seen& seen, const std::string& description) {
  if (!seen.delivers()) {
    std::printf("%s\n", description.c_str());
    return;
  }
  std::printf("%s %s: answers; model %s, serial %s, firmware %s, %" PRIu64 " %s so far\n",
              name_of(s), seen.info.address.c_str(), seen.info.model.c_str(),
              seen.info.serial.c_str(), seen.info.firmware.c_str(), seen.samples,
              s == Sensor::spd ? "tags" : "frames");
}

}  // namespace

Devices::Devices(boost::asio::io_context& io, const Config& config, const Clock& clock,
                 SampleSink& next, port::RawKeeper* raw)
    : io_(io), next_(next) {
  for (const Sensor s : all_sensors) {
    seen(s).configured = (config.configured() >> static_cast<unsigned>(s)) & 1u;
    seen(s).info.address = address_of(config, s);
  }
  if (seen(Sensor::spd).configured) drivers_[0] = make_tdc(io, config.tdc, clock, raw);
  if (seen(Sensor::radar).configured) drivers_[1] = make_radar(io, config.radar, clock, raw);
  if (seen(Sensor::depth).configured) drivers_[2] = make_depth(io, config.depth, clock, raw);
}

Devices::~Devices() { stop(); }

void Devices::start() {
  for (auto& driver : drivers_)
    if (driver) driver->start(*this);
}

void Devices::stop() {
  for (auto& driver : drivers_)
    if (driver) std::exchange(driver, nullptr)->stop();
}

void Devices::wait(double timeout_s) {
  using Clock = std::chrono::steady_clock;
  const auto give_up = Clock::now() + from_seconds(timeout_s);
  while (!all(&Seen::delivers) && Clock::now() < give_up && !interrupted()) {
    if (io_.stopped()) io_.restart();
    io_.run_one_for(std::chrono::milliseconds(20));
  }
}

std::vector<Counter> Devices::counters(Sensor s) const {
  const auto& driver = drivers_[static_cast<std::size_t>(s)];
  return driver ? driver->counters() : std::vector<Counter>{};
}

bool Devices::all(const std::function<bool(const Seen&)>& predicate) const {
  for (const auto& device : seen_)
    if (device.configured && !predicate(device)) return false;
  return true;
}

std::string Devices::describe(Sensor s) const {
  const Seen& device = (*this)[s];
  std::string text = std::string(name_of(s)) + " " + device.info.address + ": ";
  if (device.state == DeviceState::streaming && device.samples == 0)
    return text + "answers, but sends no " + (s == Sensor::spd ? "tags" : "frames");
  text += name_of(device.state);
  return device.last_event.empty() ? text : text + ": " + device.last_event;
}

void Devices::on_tags(const TagBlock& block) {
  seen(Sensor::spd).samples += block.tags.size();
  next_.on_tags(block);
}

void Devices::on_radar(RadarFrame frame) {
  ++seen(Sensor::radar).samples;
  next_.on_radar(std::move(frame));
}

void Devices::on_depth(DepthFrame frame) {
  ++seen(Sensor::depth).samples;
  next_.on_depth(std::move(frame));
}

void Devices::on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) {
  Seen& device = seen(sensor);
  device.state = state;
  if (state == DeviceState::streaming) device.info = info;
  next_.on_state(sensor, state, info);
}

void Devices::on_event(Sensor sensor, Severity severity, const std::string& text) {
  if (severity != Severity::info) seen(sensor).last_event = text;
  next_.on_event(sensor, severity, text);
}

namespace {

// Asks the configured devices; prints them, or puts them into `list`.
bool all_answer(const Config& config, const Clock& clock, nlohmann::ordered_json* list) {
  boost::asio::io_context io;
  NullSink nothing;
  Devices devices(io, config, clock, nothing);
  devices.start();
  devices.wait(config.connect_timeout_s);
  for (const Sensor s : all_sensors) {
    if (!devices[s].configured) continue;
    if (list)
      list->push_back(to_json(s, devices[s]));
    else
      print_device(s, devices[s], devices.describe(s));
  }
  return devices.all(&Devices::Seen::delivers);
}

}  // namespace

ExitCode check_devices(const std::optional<Config>& config, const Clock& clock, bool json) {
  const AttachedList attached = find_attached();
  if (!json) std::printf("%s", to_text(attached).c_str());
  std::fflush(stdout);
  auto configured = nlohmann::ordered_json::array();
  const bool ok = !config || all_answer(*config, clock, json ? &configured : nullptr);
  if (json) {
    nlohmann::ordered_json all{{"configured", configured}};
    all["attached"] = nlohmann::ordered_json::parse(to_json(attached));
    std::printf("%s\n",
                all.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace).c_str());
  }
  return ok ? ExitCode::ok : ExitCode::device;
}

}  // namespace echofuse::acquire

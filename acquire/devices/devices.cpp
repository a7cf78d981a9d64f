// SPDX-License-Identifier: MIT
#include "acquire/devices/devices.hpp"

#include <algorithm>
#include <utility>

#include "drivers/util/console.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

constexpr auto calibration_keeps = std::chrono::hours(90 * 24);
constexpr auto stop_timeout = std::chrono::milliseconds(300);  // maximum time to stop all drivers

// Returns the serial number of the device, or its model if the serial number is unknown.
template <class Device>
const std::string& identity_of(const Device& device) {
  return device.serial.empty() ? device.model : device.serial;
}

}  // namespace

Devices::Devices(port::Loop& loop, const Config& config, SampleSink& next, port::RawKeeper* raw,
                 const MakeRecording& recording)
    : loop_(loop),
      config_(config),
      next_(&next),
      live_(!recording),
      samples_(config.window_s,
               [this](Sensor sensor, const std::string& text) {
                 on_event(sensor, Severity::warning, text);
               }),
      tags_(config.histogram, live_,
            [this](const std::string& text) { on_event(Sensor::spd, Severity::warning, text); }),
      take_tags_([this](const TagBlock& repaired) {
        clocks_.observe(repaired);
        status(Sensor::spd).samples += repaired.tags.size();
        next_->on_tags(repaired);
      }) {
  for (const Sensor s : all_sensors) {
    status(s).configured = config.configured().contains(s);
    status(s).info.address = addresses_of(config, s)[0];
    if (const auto* entry = config.calibration.find(s)) identities_[s] = identity_of(*entry);
    if (!status(s).configured) continue;
    drivers_[s] = recording            ? recording(s)
                  : s == Sensor::spd   ? make_tdc(loop, config.tdc, raw)
                  : s == Sensor::radar ? make_radar(loop, config.radar, raw)
                                       : make_depth(loop, config.depth, raw);
  }
}

Devices::~Devices() { abandon(); }  // the sink may be destroyed

void Devices::take_free(const std::string& command) {
  locks_.emplace(config_, command);
  for (const Sensor s : all_sensors) status(s).holder = locks_->other(s);
}

void Devices::take(const std::string& command, const std::string& run) {
  locks_.emplace(config_, command, run);
  std::string taken;
  for (const Sensor s : all_sensors) {
    status(s).holder = locks_->other(s);
    if (!status(s).holder) continue;
    if (!taken.empty()) taken += '\n';
    taken += describe(s);
  }
  if (!taken.empty()) throw Error(ExitCode::device, taken);
}

void Devices::start() {
  const std::string oldest = iso8601(loop_.utc() - calibration_keeps);
  for (const auto& entry : config_.calibration.entries)
    // ISO 8601 times can be compared as strings.
    if (status(entry.sensor).configured && entry.date_utc < oldest)
      next_->on_event(entry.sensor, Severity::warning,
                      "the calibration of " + printable(entry.date_utc, 40) +
                          " is older than 90 days; calibrate again");
  for (const Sensor s : all_sensors)
    if (auto& driver = drivers_[s]; driver && !status(s).holder) driver->start(*this);
}

void Devices::stop() {
  for (const Sensor s : halt())
    next_->on_event(s, Severity::warning,
                    "the device did not confirm the stop and may still be sending");
  tags_.flush(take_tags_);
  tags_.finish();
  samples_.finish();
}

// Stops all drivers. Returns the sensors that did not confirm the stop in time.
std::vector<Sensor> Devices::halt() {
  for (auto& driver : drivers_)
    if (driver) driver->stop();
  const auto ends = [](const auto& driver) { return !driver || driver->finished(); };
  loop_.run_until([&] { return std::all_of(drivers_.begin(), drivers_.end(), ends); },
                  loop_.now() + stop_timeout);
  std::vector<Sensor> unfinished;
  for (const Sensor s : all_sensors) {
    auto& driver = drivers_[s];
    if (!driver) continue;
    if (!driver->finished()) unfinished.push_back(s);
    last_counters_[s] = driver->counters();
    driver.reset();
  }
  return unfinished;
}

void Devices::wait(double timeout_s) {
  const auto settled = [](const Status& device) { return device.holder || device.delivers(); };
  const auto wrong = [](const Status& device) {
    return device.state == DeviceState::misconfigured;
  };
  loop_.run_until(
      [&] { return all(settled) || interrupted() || std::ranges::any_of(status_, wrong); },
      loop_.now() + from_seconds(timeout_s));
}

void Devices::refuse_misconfigured() const {
  for (const Sensor s : all_sensors)
    if (status_[s].state == DeviceState::misconfigured) throw Error(ExitCode::config, describe(s));
}

std::vector<Counter> Devices::counters(Sensor s) const {
  const auto& driver = drivers_[s];
  return driver ? driver->counters() : last_counters_[s];
}

bool Devices::all(const std::function<bool(const Status&)>& predicate) const {
  for (const auto& device : status_)
    if (device.configured && !predicate(device)) return false;
  return true;
}

std::string Devices::describe(Sensor s) const {
  const Status& device = (*this)[s];
  std::string text = std::string(name_of(s)) + " " + printable(device.info.address) + ": ";
  if (device.holder) return text + "in use by " + printable(device.holder->who);
  if (!device.refusal.empty() && device.samples == 0) return text + printable(device.refusal, 500);
  if (device.state == DeviceState::streaming && device.samples == 0)
    return text + "answers, but sends no " + (s == Sensor::spd ? "tags" : "frames");
  text += name_of(device.state);
  return device.last_event.empty() ? text : text + ": " + printable(device.last_event, 500);
}

void Devices::on_tags(const TagBlock& block) { tags_.take(block, take_tags_); }

void Devices::on_histogram(HistogramFrame frame) {
  if (!samples_.take(frame)) return;
  clocks_.observe(frame);
  status(Sensor::spd).samples += frame.pulses + frame.clicks();
  next_->on_histogram(std::move(frame));
}

void Devices::on_radar(RadarFrame frame) {
  const bool bridged = !config_.radar.address.empty();
  if (bridged) samples_.take(frame);
  if (live_) clocks_.observe(frame);
  ++status(Sensor::radar).samples;
  next_->on_radar(std::move(frame));
}

void Devices::on_depth(DepthFrame frame) {
  samples_.take(frame);
  clocks_.observe(frame);
  ++status(Sensor::depth).samples;
  next_->on_depth(std::move(frame));
}

void Devices::warn_of_another(Sensor sensor, const DeviceInfo& info) {
  constexpr PerSensor<const char*> nouns{"time tagger ", "radar ", "camera "};
  const std::string& now = identity_of(info);
  const std::string before = std::exchange(identities_[sensor], now);
  if (before.empty() || before == now) return;
  next_->on_event(sensor, Severity::warning,
                  nouns[sensor] + printable(now, 80) + ", previously " + printable(before, 80) +
                      ": the calibration may belong to another device");
}

void Devices::on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) {
  if (sensor == Sensor::spd && state == DeviceState::ended) tags_.flush(take_tags_);
  Status& device = status(sensor);
  device.state = state;
  if (!device.refused) device.refusal.clear();
  if (state == DeviceState::streaming) warn_of_another(sensor, info);
  if (state == DeviceState::streaming || !info.firmware.empty()) device.info = info;
  next_->on_state(sensor, state, info);
  for (const Axis& axis : info.axes) samples_.take(axis);
}

void Devices::abandon() {
  static SampleSink no_sink;
  next_ = &no_sink;
  halt();
}

void Devices::on_event(Sensor sensor, Severity severity, const std::string& text) {
  if (Status& device = status(sensor); severity != Severity::info) {
    device.last_event = text;
    // The first warning of a streaming device states why there are no samples, if there are none.
    const bool first = device.state == DeviceState::streaming && device.refusal.empty();
    if (severity == Severity::error || first) device.refusal = text;
    device.refused |= severity == Severity::error;
  }
  next_->on_event(sensor, severity, text);
}

}  // namespace echofuse::acquire

// SPDX-License-Identifier: MIT
#include "acquire/doctor/doctor.hpp"

#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "acquire/devices/ask.hpp"
#include "acquire/intake/clock_fit.hpp"
#include "acquire/intake/signal_check.hpp"
#include "acquire/intake/window.hpp"
#include "acquire/run/disk.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

constexpr const char* grades[] = {"ok", "warning", "problem"};

const char* name_of(Grade grade) { return grades[static_cast<std::size_t>(grade)]; }

// Prints each finding immediately as text, or all findings at the end as JSON.
class DoctorReport {
 public:
  explicit DoctorReport(bool json) : json_(json) {}

  void add(const Finding& finding) {
    if (finding.grade == Grade::problem && (code_ == ExitCode::ok || finding.failure < code_))
      code_ = finding.failure;
    if (!json_) return print(finding);
    auto facts = nlohmann::ordered_json::object();
    for (const auto& [name, value] : finding.facts) facts[name] = value;
    checks_.push_back({{"check", finding.check},
                       {"grade", name_of(finding.grade)},
                       {"found", finding.found},
                       {"advice", finding.advice},
                       {"facts", facts}});
  }
  void add(const std::vector<Finding>& findings) {
    for (const Finding& finding : findings) add(finding);
  }

  ExitCode finish() const {
    if (!json_) return code_;
    const nlohmann::ordered_json all{
        {"schema", 1}, {"checks", checks_}, {"exit_code", static_cast<int>(code_)}};
    std::printf("%s\n",
                all.dump(2, ' ', true, nlohmann::ordered_json::error_handler_t::replace).c_str());
    return code_;
  }

 private:
  static void print(const Finding& finding) {
    const std::string advice = finding.advice.empty() ? "" : " -> " + printable(finding.advice);
    const auto padded = [](std::string text, std::size_t width) {
      return text.append(std::max(width, text.size() + 1) - text.size(), ' ');
    };
    echofuse::print(padded(name_of(finding.grade), 9) + padded(finding.check, 14) +
                    printable(finding.found) + advice);
    std::fflush(stdout);
  }

  bool json_;
  ExitCode code_ = ExitCode::ok;
  nlohmann::ordered_json checks_ = nlohmann::ordered_json::array();
};

constexpr double capture_s = 2;

// Forwards all samples to a capture. After begin(), also collects them in a single slot, as in a
// run.
class Trial final : public SampleSink {
 public:
  Trial(Capture& capture, const Config& config) : capture_(capture), config_(config) {}
  void begin(HostTime now) {
    windows_.emplace(SlotGrid{now, from_seconds(capture_s)}, config_.histogram, clocks_,
                     config_.configured());
    for (const Sensor s : all_sensors)
      if (devices_[s]) windows_->announce(*devices_[s]);
  }
  // Closes the slot and returns its record, with the same verdicts as in a run.
  record::FusedRecord checked_record() {
    record::FusedRecord record = windows_->close({0, false});
    SignalLimits limits = config_.signal;
    limits.spd_clicks *= capture_s / config_.window_s;
    SignalCheck(limits, capture_s, config_.nominal_hz(), config_.map.far_m)
        .assess(record, windows_->axes());
    return record;
  }

  void on_tags(const TagBlock& block) override {
    capture_.on_tags(block);
    put(block);
  }
  void on_histogram(HistogramFrame frame) override {
    put(frame);
    capture_.on_histogram(std::move(frame));
  }
  void on_radar(RadarFrame frame) override {
    put(frame);
    capture_.on_radar(std::move(frame));
  }
  void on_depth(DepthFrame frame) override {
    put(frame);
    capture_.on_depth(std::move(frame));
  }
  void on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) override {
    if (state != DeviceState::streaming) return;
    devices_[sensor] = info;
    if (windows_) windows_->announce(info);
  }
  void on_event(Sensor sensor, Severity severity, const std::string& text) override {
    capture_.on_event(sensor, severity, text);
  }

 private:
  template <class Sample>
  void put(const Sample& sample) {
    clocks_.observe(sample);
    if (windows_) windows_->add(sample);
  }
  Capture& capture_;
  const Config& config_;
  PerSensor<std::optional<DeviceInfo>> devices_;
  SensorClocks clocks_;
  std::optional<Windows> windows_;
};

std::vector<Finding> findings_of(const Answer& answer, const Capture& capture, const Config& config,
                                 double time_s, const std::optional<record::FusedRecord>& record) {
  const char* check = name_of(answer.sensor);
  if (answer.status.holder)
    return {{check, answer.delivers ? Grade::warning : Grade::problem, answer.text,
             "stop the program that uses the device, or wait until it ends"}};
  if (answer.status.state == DeviceState::misconfigured)
    return {{.check = check,
             .grade = Grade::problem,
             .found = answer.text,
             .advice = "correct the configuration; `devices` lists the ports of each board",
             .failure = ExitCode::config}};
  if (!answer.delivers) {  // answer.text contains the driver's last warning or error
    const bool answered = answer.status.refused || !answer.status.info.firmware.empty();
    return {{check, Grade::problem, answer.text,
             answered ? ""
                      : "check the power, the cable and the address of the device; see `devices`"}};
  }
  constexpr PerSensor<decltype(&spd_finding)> finders{spd_finding, radar_finding, depth_finding};
  std::vector<Finding> out{finders[answer.sensor](capture, config, time_s)};
  if (record && record->has(answer.sensor) && out[0].grade == Grade::ok)
    if (const auto& sync = record->sync[answer.sensor]; sync.doubtful()) {
      out[0].grade = Grade::warning;
      out[0].advice = sync.text();
    }
  for (const auto& complaint : capture.complaints[answer.sensor])
    out.push_back({check, Grade::warning, complaint});
  return out;
}

// Checks 2 s of data from each device that delivers data. Returns the estimated size of a record in
// bytes.
double check_devices(const Config& config, port::Loop& loop, DoctorReport& report) {
  Capture capture(config.histogram);
  Trial trial(capture, config);
  std::optional<record::FusedRecord> record;
  double time_s = 0;
  const auto answers = ask(config, loop, "doctor", trial, [&] {
    capture.begin();
    const HostTime begin = loop.now();
    trial.begin(begin);
    loop.run_until(interrupted, begin + from_seconds(capture_s));
    time_s = seconds(loop.now() - begin);
    capture.end();
    record = trial.checked_record();
  });
  if (interrupted())
    throw Error(ExitCode::interrupted, "interrupted before the checks were complete");
  for (const Answer& answer : answers)
    report.add(findings_of(answer, capture, config, time_s, record));
  return estimate_record_bytes(capture, config);
}

}  // namespace

ExitCode examine(const std::optional<Config>& config, const DoctorOptions& options,
                 port::Loop& loop) {
  DoctorReport report(options.json);
  report.add(check_permissions(config, options.roots));
  report.add(check_modem_manager(config, options.roots));
  report.add(check_usb_memory(config, options.roots));
  report.add(check_usb_power(config, options.roots));
  report.add(check_open_files(open_files_limit()));
  report.add(processor_finding());
  report.add(check_clock(read_clock()));
  const bool named = config && !config->run_folder.empty();
  PlannedRun plan{.folder = std::filesystem::absolute(named ? config->run_folder : ".").string(),
                  .count = options.count};
  if (config) {
    for (const std::string& fault : config->unfinished)
      report.add({.check = "configuration",
                  .grade = Grade::problem,
                  .found = fault,
                  .advice = "correct this key of the configuration",
                  .failure = ExitCode::config});
    plan.record_bytes = check_devices(*config, loop, report);
    plan.window_s = config->window_s;
  }
  report.add(check_disk(plan));
  return report.finish();
}

}  // namespace echofuse::acquire

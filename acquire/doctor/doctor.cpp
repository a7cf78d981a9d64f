// SPDX-License-Identifier: MIT
#include "acquire/doctor/doctor.hpp"

#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "acquire/devices/device_check.hpp"
#include "acquire/run/disk.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

constexpr const char* grades[] = {"ok", "warning", "problem"};

const char* name_of(Grade grade) { return grades[static_cast<std::size_t>(grade)]; }

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

std::vector<Finding> findings_of(const Answer& answer, const Capture& capture,
                                 const Config& config) {
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
    const bool answered = !answer.status.refusal.empty() || !answer.status.info.firmware.empty();
    return {{check, Grade::problem, answer.text,
             answered ? ""
                      : "check the power, the cable and the address of the device; see `devices`"}};
  }
  constexpr PerSensor<decltype(&spd_finding)> finders{spd_finding, radar_finding, depth_finding};
  std::vector<Finding> out{finders[answer.sensor](capture, config)};
  const record::SensorSync& sync = capture.record.sync[answer.sensor];
  if (out[0].grade == Grade::ok && sync.doubtful()) {
    const bool as_in_run = config.window_s <= Capture::slot_s;  // longer slots contain more
    out[0].grade =
        as_in_run && !capture.record.has(answer.sensor) ? Grade::problem : Grade::warning;
    out[0].advice = sync.text();
  }
  for (const auto& complaint : capture.complaints[answer.sensor])
    out.push_back({check, Grade::warning, complaint});
  return out;
}

// Checks one slot of data from each device that delivers data. Returns the estimated size of a
// record in bytes.
double check_devices(const Config& config, port::Loop& loop, DoctorReport& report) {
  Capture capture(config);
  const auto answers = ask(config, loop, "doctor", capture, [&](const Devices& devices) {
    const HostTime begin = loop.now();
    capture.begin(begin, devices.clocks());
    for (const Sensor s : all_sensors)
      if (devices[s].state == DeviceState::streaming) capture.announce(devices[s].info);
    loop.run_until(interrupted, begin + from_seconds(Capture::slot_s) + grace);
    capture.end();
  });
  if (interrupted())
    throw Error(ExitCode::interrupted, "interrupted before the checks were complete");
  for (const Answer& answer : answers) report.add(findings_of(answer, capture, config));
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

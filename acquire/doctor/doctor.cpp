// SPDX-License-Identifier: MIT
#include "acquire/doctor/doctor.hpp"

#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "acquire/doctor/disk.hpp"
#include "acquire/doctor/self_test.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::acquire {
namespace {

constexpr const char* grades[] = {"ok", "warning", "problem"};

const char* name_of(Grade grade) { return grades[static_cast<std::size_t>(grade)]; }

// Text comes line by line, as a check is done; JSON at the end.
class Report {
 public:
  explicit Report(bool json) : json_(json) {}

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
    const nlohmann::ordered_json all{{"checks", checks_}, {"exit_code", static_cast<int>(code_)}};
    std::printf("%s\n",
                all.dump(2, ' ', true, nlohmann::ordered_json::error_handler_t::replace).c_str());
    return code_;
  }

 private:
  static void print(const Finding& finding) {
    std::printf("%-8s %-13s %s%s%s\n", name_of(finding.grade), finding.check.c_str(),
                printable(finding.found).c_str(), finding.advice.empty() ? "" : " -> ",
                printable(finding.advice).c_str());
    std::fflush(stdout);
  }

  bool json_;
  ExitCode code_ = ExitCode::ok;
  nlohmann::ordered_json checks_ = nlohmann::ordered_json::array();
};

}  // namespace

ExitCode examine(const std::optional<Config>& config, const DoctorOptions& options,
                 port::Loop& loop) {
  Report report(options.json);
  report.add(check_permissions(config, options.roots));
  report.add(check_modem_manager(config, options.roots));
  report.add(check_usb_memory(config, options.roots));
  report.add(check_clock(read_clock()));
  const bool named = config && !config->run_folder.empty();
  PlannedRun plan{.folder = std::filesystem::absolute(named ? config->run_folder : ".").string(),
                  .count = options.count};
  if (config) {
    const SelfTest test = test_devices(*config, loop);
    report.add(test.findings);
    plan.record_bytes = test.record_bytes;
    plan.window_s = config->window_s;
  }
  report.add(check_disk(plan));
  return report.finish();
}

}  // namespace echofuse::acquire

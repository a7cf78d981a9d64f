// SPDX-License-Identifier: MIT
#include "acquire/run/run_log.hpp"

#include <spdlog/spdlog.h>

#include <utility>

#include "drivers/program/printable.hpp"

namespace echofuse::acquire {
namespace {

constexpr unsigned most_lines = 100;
constexpr std::chrono::seconds stretch{10};

spdlog::level::level_enum level_of(Severity s) {
  constexpr spdlog::level::level_enum levels[] = {spdlog::level::info, spdlog::level::warn,
                                                  spdlog::level::err};
  return levels[static_cast<std::size_t>(s)];
}

}  // namespace

void RunLog::put(Severity severity, const std::string& source, const std::string& text,
                 bool recovery) {
  Source& of = sources_[source];
  if (const HostTime now = clock_.now(); of.lines == 0 || now - of.since >= stretch) {
    const unsigned left_out = of.left_out;
    of = {.since = now};
    if (left_out > 0)
      write(Severity::warning, source, std::to_string(left_out) + " lines were left out", true);
  }
  if (++of.lines <= most_lines)
    write(severity, source, text, recovery || severity != Severity::info);
  else
    ++of.left_out;
}

void RunLog::write(Severity severity, const std::string& source, const std::string& text,
                   bool kept) {
  spdlog::log(level_of(severity), "{}: {}", source, printable(text));
  if (!kept) return;
  Journal::Job job = [=, utc = clock_.utc()](record::RunWriter& run) {
    run.put_event(utc, severity, source, text);
  };
  if (journal_)
    journal_->put(std::move(job));
  else
    waiting_.push_back(std::move(job));
}

void RunLog::attach(Journal& journal) {
  journal_ = &journal;
  for (auto& job : std::exchange(waiting_, {})) journal.put(std::move(job));
}

}  // namespace echofuse::acquire

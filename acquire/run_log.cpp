// SPDX-License-Identifier: MIT
#include "acquire/run_log.hpp"

#include <spdlog/spdlog.h>

#include <utility>

#include "drivers/core/printable.hpp"

namespace echofuse::acquire {
namespace {

spdlog::level::level_enum level_of(Severity s) {
  constexpr spdlog::level::level_enum levels[] = {spdlog::level::info, spdlog::level::warn,
                                                  spdlog::level::err};
  return levels[static_cast<std::size_t>(s)];
}

}  // namespace

void RunLog::put(Severity severity, const std::string& source, const std::string& text) {
  spdlog::log(level_of(severity), "{}: {}", source, printable(text));
  if (severity == Severity::info) return;
  Writer::Job job = [=, utc = clock_.utc()](record::RunWriter& run) {
    run.put_event(utc, severity, source, text);
  };
  if (writer_)
    writer_->put(std::move(job));
  else
    waiting_.push_back(std::move(job));
}

void RunLog::attach(Writer& writer) {
  writer_ = &writer;
  for (auto& job : std::exchange(waiting_, {})) writer.put(std::move(job));
}

}  // namespace echofuse::acquire

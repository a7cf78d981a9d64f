// SPDX-License-Identifier: MIT
#include "acquire/run/doubt_hook.hpp"

#include <signal.h>
#include <sys/wait.h>

#include <filesystem>
#include <thread>
#include <utility>

#include "acquire/run/disk.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/program.hpp"

namespace echofuse::acquire {

DoubtHook::DoubtHook(std::vector<std::string> words, const record::AlertLimits& limits, Warn warn)
    : words_(std::move(words)), limits_(limits), warn_(std::move(warn)) {
  const std::string fault = words_.empty() ? "" : fault_of_program(words_[0]);
  if (!fault.empty()) throw Error(ExitCode::config, "alert.on_doubt: " + fault);
}

DoubtHook::~DoubtHook() { kill_program(); }

void DoubtHook::kill_program() {
  if (!program_) return;
  ::kill(-*program_, SIGKILL);
  wait_for_program(*std::exchange(program_, {}));
}

void DoubtHook::finish(HostTime now) {
  constexpr auto pause = std::chrono::milliseconds(20);
  for (auto left = std::chrono::milliseconds(1000); left > pause; left -= pause) {
    update(now);
    if (!program_ && waiting_.empty()) return;
    std::this_thread::sleep_for(pause);
  }
  if (!waiting_.empty())
    warn_("alert.on_doubt: " + std::to_string(waiting_.size()) +
          " changes were not reported because the run ended");
  waiting_.clear();
  if (ended()) return;
  kill_program();
  warn_("alert.on_doubt: " + printable(words_[0]) + " was killed because the run ended");
}

void DoubtHook::take(const record::FusedRecord& record, SensorSet configured,
                     const std::string& run) {
  for (const Sensor s : all_sensors) {
    if (!configured.contains(s)) continue;
    const std::string state = record.state(s);
    if (!states_[s].take(state, seconds(record.slot_start), seconds(record.slot_end),
                         limits_.after_s))
      continue;
    put({.source = name_of(s),
         .kind = state,
         .text = record.sync[s].text(),
         .run = run,
         .utc = iso8601(record.slot_utc),
         .record = record.index});
  }
}

void DoubtHook::take_disk(std::optional<std::uint64_t> free_bytes, UtcTime now,
                          const std::string& run) {
  if (!free_bytes) return;
  put({.source = "disk",
       .kind = record::is_disk_low(*free_bytes, limits_) ? "low" : "ok",
       .text = size_text(static_cast<double>(*free_bytes)) + " free, limit " +
               size_text(limits_.disk_free_gb * 1e9),
       .run = run,
       .utc = iso8601(now),
       .record = {}});
}

void DoubtHook::take_run(const char* kind, const std::string& text, UtcTime now,
                         const std::string& run) {
  put({.source = "run", .kind = kind, .text = text, .run = run, .utc = iso8601(now), .record = {}});
}

void DoubtHook::put(AlertChange change) {
  if (words_.empty()) return;
  std::string& before = kinds_.try_emplace(change.source, "ok").first->second;
  if (std::exchange(before, change.kind) == change.kind) return;
  if (waiting_.size() < max_waiting) return waiting_.push_back(std::move(change));
  warn_("alert.on_doubt: " + change.source + " " + change.kind +
        " was not reported because too many changes are waiting");
}

void DoubtHook::update(HostTime now) {
  if (program_ && !killed_ && now - started_ > longest) {
    killed_ = true;
    ::kill(-*program_, SIGKILL);
  }
  if (!ended() || waiting_.empty()) return;
  const AlertChange change = std::move(waiting_.front());
  waiting_.pop_front();
  start(change, now);
}

void DoubtHook::start(const AlertChange& change, HostTime now) {
  std::error_code none;
  const auto started = start_program(
      words_, {.background = true,
               .environment = {
                   "ECHOFUSE_SOURCE=" + change.source, "ECHOFUSE_DOUBT=" + change.kind,
                   "ECHOFUSE_TEXT=" + change.text, "ECHOFUSE_UTC=" + change.utc,
                   "ECHOFUSE_RUN=" + std::filesystem::absolute(change.run, none).string(),
                   "ECHOFUSE_RECORD=" + (change.record ? std::to_string(*change.record) : "")}});
  if (!started) return warn_("alert.on_doubt: " + started.failure().text());
  program_ = *started, started_ = now, killed_ = false;
}

// Returns true if no program is running. Warns if the program failed.
bool DoubtHook::ended() {
  if (!program_) return true;
  int status = 0;
  if (::waitpid(*program_, &status, WNOHANG) == 0) return false;
  program_.reset();
  const std::string name = "alert.on_doubt: " + printable(words_[0]);
  if (killed_)
    warn_(name + " was killed after " + std::to_string(longest.count()) + " s");
  else if (WIFSIGNALED(status))
    warn_(name + " was ended by signal " + std::to_string(WTERMSIG(status)));
  else if (WEXITSTATUS(status) != 0)
    warn_(name + " ended with exit code " + std::to_string(WEXITSTATUS(status)));
  return true;
}

}  // namespace echofuse::acquire

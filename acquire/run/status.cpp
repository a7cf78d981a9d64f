// SPDX-License-Identifier: MIT
#include "acquire/run/status.hpp"

#include <systemd/sd-daemon.h>
#include <unistd.h>

#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "drivers/util/console.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

constexpr std::chrono::nanoseconds terminal_pause = std::chrono::seconds(1);
constexpr std::chrono::nanoseconds log_pause = std::chrono::seconds(10);
constexpr const char* gap = "  ";
constexpr PerSensor<char> letter_of{'S', 'R', 'D'};

std::string rate_text(double tags_per_s) {
  return tags_per_s >= 1e6 ? format("%.2f Mtag/s", tags_per_s / 1e6)
                           : format("%.1f ktag/s", tags_per_s / 1e3);
}

// Formats a time as 0:07, 12:34 or 1:02:03.
std::string clock_text(double time_s) {
  const auto s = static_cast<std::int64_t>(std::max(0.0, time_s));
  return s < 3600 ? format("%" PRId64 ":%02" PRId64, s / 60, s % 60)
                  : format("%" PRId64 ":%02" PRId64 ":%02" PRId64, s / 3600, s / 60 % 60, s % 60);
}

std::string lost_text(const PerSensor<std::uint64_t>& lost) {
  std::string text;
  for (const Sensor s : all_sensors)
    if (lost[s] > 0) text += format(" %c %" PRIu64, letter_of[s], lost[s]);
  return "lost" + (text.empty() ? " 0" : text);
}

std::string sensor_letters(const RunTotals& now) {
  constexpr PerSensor<char> small{'s', 'r', 'd'};
  std::string letters;
  for (const Sensor s : all_sensors)
    if (!now.valid.contains(s))
      letters += '-';
    else if (now.doubtful.contains(s))
      letters += small[s];
    else
      letters += letter_of[s];
  return letters;
}

// Returns the number of samples per second for each sensor. `slots_s` is the total duration of the
// slots in s.
PerSensor<double> rates(std::uint64_t tags, std::uint64_t radar, std::uint64_t depth,
                        double slots_s) {
  if (slots_s <= 0) return {};
  return {static_cast<double>(tags) / slots_s, static_cast<double>(radar) / slots_s,
          static_cast<double>(depth) / slots_s};
}

// Truncates a UTF-8 string to at most `bytes` bytes without splitting a character.
std::string shortened(std::string text, std::size_t bytes) {
  if (text.size() <= bytes) return text;
  while (bytes > 0 && (static_cast<unsigned char>(text[bytes]) & 0xc0U) == 0x80U) --bytes;
  return text.substr(0, bytes);
}

bool given(const char* variable) {
  const char* value = std::getenv(variable);
  return value && *value;
}

bool is_terminal() {
  const char* kind = std::getenv("TERM");
  return isatty(STDERR_FILENO) && kind && *kind && std::strcmp(kind, "dumb") != 0;
}

}  // namespace

void RunTotals::take(const record::FusedRecord& record, SensorSet configured,
                     const std::function<void(Sensor, Severity)>& changed) {
  ++records;
  const double slot_s = seconds(record.slot_end - record.slot_start);
  const auto& in = record.statistics;
  tags += record.spd_counts.tags, radar_frames += in.radar_frames, depth_frames += in.depth_frames;
  slots_s += slot_s;
  rate_hz = rates(record.spd_counts.tags, in.radar_frames, in.depth_frames, slot_s);
  valid = record.valid;
  signal = record.signal;
  doubtful = {};
  trouble.clear();
  for (const Sensor s : all_sensors) {
    lost[s] += record.sync[s].lost;
    if (!configured.contains(s)) continue;
    const record::SensorSync& sync = record.sync[s];
    const std::string word = sync.word();
    if (sync.doubtful()) {
      doubtful.insert(s);
      if (trouble.empty()) trouble = name_of(s) + (" " + word);
    }
    if (std::exchange(words[s], word) != word)
      changed(s, sync.doubtful() ? Severity::warning : Severity::info);
  }
  not_ok += !doubtful.empty();
  incomplete += !record.missing.empty();
}

std::string RunTotals::doubts() const {
  std::string text;
  if (incomplete > 0)
    text += format("; %" PRId64 " incomplete because a required device sent no data", incomplete);
  if (not_ok > 0) text += format("; %" PRId64 " with a sensor that is not ok", not_ok);
  return text;
}

std::string count_text(std::int64_t written, std::optional<std::int64_t> planned) {
  std::string text = std::to_string(written);
  if (planned) text += " of " + std::to_string(*planned);
  return text + " records";
}

std::vector<StatusField> status_fields(const RunTotals& now, const StatusTimes& times) {
  constexpr std::size_t longest_label = 24;
  std::vector<StatusField> out;
  const auto put = [&](int rank, std::string text, bool bad = false) {
    if (!text.empty()) out.push_back({std::move(text), rank, bad});
  };
  const bool bad = !now.doubtful.empty();
  std::string count = "record " + std::to_string(now.records);
  if (times.records) count.append("/").append(std::to_string(*times.records));
  put(0, std::move(count));
  put(0, sensor_letters(now), bad);
  put(1, now.trouble, bad);
  std::string time = clock_text(times.elapsed_s);
  if (times.remaining_s) time.append(", ").append(clock_text(*times.remaining_s)).append(" left");
  put(2, std::move(time));
  put(4, rate_text(now.rate_hz[Sensor::spd]));
  if (now.signal.spd_peak_m) put(6, format("peak %.2f m", *now.signal.spd_peak_m));
  put(5, format("radar %.1f fps", now.rate_hz[Sensor::radar]) +
             (now.signal.radar_snr_db ? format(" %.0f dB", *now.signal.radar_snr_db) : ""));
  put(7, format("depth %.1f fps", now.rate_hz[Sensor::depth]));
  put(3, lost_text(now.lost));
  put(8, shortened(printable(now.label), longest_label));
  if (now.free_bytes) {
    const double gb = static_cast<double>(*now.free_bytes) / 1e9;
    put(9, format(gb < 10 ? "%.1f GB free" : "%.0f GB free", gb));
  }
  put(10, "on disk " + std::to_string(now.written));
  return out;
}

std::string status_line(const std::vector<StatusField>& fields, std::optional<std::size_t> columns,
                        bool colours) {
  std::vector<const StatusField*> by_rank;
  for (const auto& f : fields) by_rank.push_back(&f);
  std::stable_sort(by_rank.begin(), by_rank.end(),
                   [](const auto* a, const auto* b) { return a->rank < b->rank; });
  std::size_t used = 0;
  std::vector<const StatusField*> shown;
  for (const auto* f : by_rank) {
    const std::size_t expected = f->text.size() + (used > 0 ? std::strlen(gap) : 0);
    if (columns && used + expected > *columns) continue;
    used += expected;
    shown.push_back(f);
  }
  std::string line;
  for (const auto& f : fields) {
    if (std::find(shown.begin(), shown.end(), &f) == shown.end()) continue;
    if (!line.empty()) line += gap;
    line += f.bad && colours ? "\033[31m" + f.text + "\033[0m" : f.text;
  }
  return line;
}

StatusLine::StatusLine(HostTime start, double window_s, std::optional<std::int64_t> total,
                       bool quiet, ShowLine show)
    : show_(show ? std::move(show) : [](const std::string& text) {
        std::fputs(text.c_str(), stderr);
        std::fflush(stderr);
      }),
      total_(total),
      window_s_(window_s),
      quiet_(quiet),
      terminal_(is_terminal()),
      colours_(terminal_ && !given("NO_COLOR")),
      start_(start),
      shown_(start) {}

StatusLine::~StatusLine() {
  if (drawn_ && terminal_) show_("\n");
}

void StatusLine::update(HostTime now, const RunTotals& totals) {
  const bool worse = terminal_ && !(totals.doubtful - before_.doubtful).empty();
  if (worse || now - shown_ >= (terminal_ ? terminal_pause : log_pause))
    show(now, totals, worse ? "\a" : "");
}

void StatusLine::finish(HostTime now, const RunTotals& totals) {
  RunTotals mean = totals;
  mean.rate_hz = rates(totals.tags, totals.radar_frames, totals.depth_frames, totals.slots_s);
  show(now, mean, "", terminal_ ? "\n" : "");
  drawn_ = false;
}

void StatusLine::show(HostTime now, const RunTotals& totals, const char* before,
                      const char* after) {
  if (!quiet_) {
    StatusTimes times{.elapsed_s = seconds(now - start_), .remaining_s = {}, .records = total_};
    if (total_)
      times.remaining_s = std::max(0.0, static_cast<double>(*total_) * window_s_ - times.elapsed_s);
    const auto fields = status_fields(totals, times);
    // The last column stays empty, because some terminals wrap a line that fills the last column.
    const std::string line =
        terminal_ ? "\r\033[K" + status_line(fields, columns_of_terminal() - 1, colours_)
                  : status_line(fields, std::nullopt, false) + "\n";
    show_(before + line + after);
    drawn_ = true;
  }
  before_ = totals;
  shown_ = now;
}

void notify_ready(double window_s) {
  constexpr double slots = 4, us_per_s = 1e6;
  const double timeout_us = slots * window_s * us_per_s;
  std::uint64_t limit_us = 0;
  if (sd_watchdog_enabled(0, &limit_us) > 0 && static_cast<double>(limit_us) < timeout_us)
    sd_notifyf(0, "WATCHDOG_USEC=%" PRIu64, static_cast<std::uint64_t>(timeout_us));
  sd_notify(0, "READY=1\nSTATUS=0 records on disk");
}

void notify_advance(std::int64_t records) {
  sd_notifyf(0, "WATCHDOG=1\nSTATUS=%" PRId64 " records on disk", records);
}

void notify_stopping() { sd_notify(0, "STOPPING=1"); }

}  // namespace echofuse::acquire

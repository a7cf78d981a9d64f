// SPDX-License-Identifier: MIT
#include "recon/view/text_view.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string_view>
#include <thread>

#include "drivers/program/console.hpp"
#include "drivers/program/printable.hpp"
#include "recon/numbers/text.hpp"
#include "recon/view/pictures.hpp"

namespace echofuse::view {
namespace {

using recon::formatted;
constexpr std::size_t width = 80, chart_rows = 6;
constexpr std::array<const char*, 9> blocks{" ", "▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"};

std::string clock_text(double time_s) {
  const auto s = static_cast<std::int64_t>(std::max(0.0, time_s));
  return formatted("%" PRId64 ":%02" PRId64 ":%02" PRId64, s / 3600, s / 60 % 60, s % 60);
}

// Returns a line of ASCII: `left`, blanks, `right`.
std::string spread(const std::string& left, const std::string& right) {
  const std::size_t used = left.size() + right.size();
  return left + std::string(used < width ? width - used : 1, ' ') + right;
}

struct Lamp {
  const char *word, *colour;
};
// The same as on the page.
Lamp lamp_of(const SensorState& s, bool live, bool stale) {
  if (!s.configured) return {"off ", "\033[2m"};
  if (live ? stale : !s.valid) return {"LOST", "\033[31m"};
  if (!s.valid || s.verdict != "ok") return {"LOOK", "\033[33m"};
  return {"ok  ", "\033[32m"};
}

std::string lamps(const FollowedRun& run, UtcTime now, bool colours) {
  std::string out;
  for (const Sensor s : all_sensors) {
    const SensorState& sensor = run.sensors()[s];
    const Lamp lamp = lamp_of(sensor, run.live(), is_stale(sensor, run.info().window_s, now));
    const auto age = age_s(sensor, now);
    const std::string word = std::string("[") + lamp.word + "]";
    const std::string when =
        run.live() ? (age ? formatted("%5.1f s ago", *age) : std::string("      never")) : "";
    const std::string rest =
        formatted(" %-5s %s  lost %" PRIu64 "  ", name_of(s), when.c_str(), sensor.lost) +
        sensor.verdict;
    out += (colours ? lamp.colour + word + "\033[0m" : word) +
           printable(rest, width - word.size()) + "\n";
  }
  return out;
}

std::string axis_line(const Axis& axis, double to_m) {
  const double first = axis.start * to_m, last = axis.at(axis.count) * to_m;
  return spread(formatted("%.1f m", first), formatted("%.1f m", last)) + "\n";
}

std::string histogram(const record::FusedRecord& r, const Axis& axis) {
  const std::vector<float> counts(r.spd.begin(), r.spd.end());
  const float most = counts.empty() ? 0 : *std::max_element(counts.begin(), counts.end());
  return spread("SPD, clicks a bin", formatted("most %.0f", double{most})) + "\n" +
         block_chart(counts, width, chart_rows, 0, most) + axis_line(axis, 1 / ps_per_m);
}

std::string profile(const record::FusedRecord& r, const Axis& axis) {
  const std::vector<float> db = to_db(r.radar, axis);
  if (db.empty()) return {};
  std::vector<float> sorted = db;
  std::sort(sorted.begin(), sorted.end());
  const float floor = sorted[sorted.size() / 2], most = sorted.back();
  return spread("radar, dB over the median", formatted("most %.1f dB", double{most - floor})) +
         "\n" + block_chart(db, width, chart_rows, floor, most) + axis_line(axis, 1);
}

}  // namespace

std::string block_chart(std::span<const float> values, std::size_t columns, std::size_t rows,
                        float floor, float ceiling) {
  std::vector<int> heights(columns);
  const float span = ceiling > floor ? ceiling - floor : 1;
  for (std::size_t c = 0; c < columns && !values.empty(); ++c) {
    const std::size_t begin = c * values.size() / columns;
    const std::size_t end = std::max(begin + 1, (c + 1) * values.size() / columns);
    const float most = *std::max_element(values.begin() + static_cast<std::ptrdiff_t>(begin),
                                         values.begin() + static_cast<std::ptrdiff_t>(end));
    const float share = std::clamp((most - floor) / span, 0.0F, 1.0F);
    heights[c] = static_cast<int>(std::lround(share * static_cast<float>(8 * rows)));
  }
  std::string out;
  for (std::size_t row = rows; row-- > 0;) {
    for (const int h : heights)
      out += blocks[static_cast<std::size_t>(std::clamp(h - 8 * static_cast<int>(row), 0, 8))];
    out += '\n';
  }
  return out;
}

std::string text_page(const FollowedRun& run, std::optional<std::int64_t> planned, UtcTime now,
                      bool colours) {
  const auto& all = run.outlines();
  std::string count = formatted("%zu", all.size());
  if (planned) count += formatted("/%" PRId64, *planned);
  const UtcTime begun = all.empty() ? now : all.front().start;
  const UtcTime end = run.live() || all.empty() ? now : all.back().end;
  std::string right = count + " records  " + clock_text(seconds(end - begun));
  if (planned && run.live())
    right += ", " +
             clock_text((static_cast<double>(*planned) - static_cast<double>(all.size())) *
                        run.info().window_s) +
             " left";
  std::string out = spread(printable(std::filesystem::path(run.path()).filename().string(), 30) +
                               "  " + printable(run.info().status, 20),
                           right) +
                    "\n" + lamps(run, now, colours);
  if (all.empty()) return out + "no record yet\n";
  run.with_reader([&](const record::RunReader& reader) {
    const record::FusedRecord r = reader.read(all.back().index);
    for (const Axis& a : reader.axes()) {
      if (a.name == "spd" && r.has(Sensor::spd)) out += histogram(r, a);
      if (a.name == "radar" && r.has(Sensor::radar)) out += profile(r, a);
    }
    std::string bottom = "record " + std::to_string(r.index);
    if (!r.label.empty()) bottom += ", label " + r.label;
    if (const auto free = run.free_bytes())
      bottom += formatted(", %.3g GB free", static_cast<double>(*free) / 1e9);
    if (!run.events().empty())
      bottom += "; " + run.events().back().source + ": " + run.events().back().text;
    out += printable(bottom, width) + "\n";
  });
  return out;
}

ExitCode text_view(FollowedRun& run, std::optional<std::int64_t> planned, const Clock& clock) {
  const char* no_colour = std::getenv("NO_COLOR");
  const bool terminal = ::isatty(STDOUT_FILENO) != 0;
  const bool colours = terminal && !(no_colour && *no_colour);
  do {
    run.refresh();
    if (!run.trouble().empty()) throw Error(ExitCode::failed, run.trouble());
    const std::string page = text_page(run, planned, clock.utc(), colours);
    std::printf("%s%s", terminal && run.live() ? "\033[H\033[J" : "", page.c_str());
    std::fflush(stdout);
    for (int i = 0; i < 10 && terminal && run.live() && !interrupted(); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
  } while (terminal && run.live() && !interrupted());
  return ExitCode::ok;
}

}  // namespace echofuse::view

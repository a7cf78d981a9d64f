// SPDX-License-Identifier: MIT
#include "acquire/status.hpp"

#include <unistd.h>

#include <cinttypes>
#include <cstdio>

namespace echofuse::acquire {
namespace {

constexpr std::chrono::nanoseconds terminal_pause = std::chrono::seconds(1);
constexpr std::chrono::nanoseconds log_pause = std::chrono::seconds(10);

std::string rate_text(double tags_per_s) {
  char text[32];
  if (tags_per_s >= 1e6)
    std::snprintf(text, sizeof text, "%.2f Mtag/s", tags_per_s / 1e6);
  else
    std::snprintf(text, sizeof text, "%.1f ktag/s", tags_per_s / 1e3);
  return text;
}

}  // namespace

std::string status_text(const RunTotals& now, const RunTotals& before, double elapsed_s,
                        std::optional<std::int64_t> total) {
  const auto rate = [&](std::uint64_t a, std::uint64_t b) {
    return elapsed_s > 0 ? static_cast<double>(a - b) / elapsed_s : 0.0;
  };
  std::string mask = "SRD";
  for (std::size_t s = 0; s < mask.size(); ++s)
    if (!((now.valid >> s) & 1u)) mask[s] = '-';
  std::string count = std::to_string(now.records);
  if (total) count.append("/").append(std::to_string(*total));
  char text[200];
  std::snprintf(text, sizeof text,
                "record %s  %s  %s  radar %.1f fps  depth %.1f fps  lost %" PRIu64
                "  on disk %" PRId64,
                count.c_str(), mask.c_str(), rate_text(rate(now.tags, before.tags)).c_str(),
                rate(now.radar_frames, before.radar_frames),
                rate(now.depth_frames, before.depth_frames), now.lost, now.written);
  return text;
}

StatusLine::StatusLine(HostTime start, std::optional<std::int64_t> total, bool quiet)
    : total_(total),
      quiet_(quiet),
      terminal_(isatty(STDERR_FILENO) != 0),
      start_(start),
      shown_(start) {}

StatusLine::~StatusLine() {
  if (drawn_ && terminal_) std::fputc('\n', stderr);
}

void StatusLine::update(HostTime now, const RunTotals& totals) {
  if (now - shown_ >= (terminal_ ? terminal_pause : log_pause)) show(now, totals);
}

void StatusLine::finish(HostTime now, const RunTotals& totals) {
  before_ = {};
  shown_ = start_;
  show(now, totals);
}

void StatusLine::show(HostTime now, const RunTotals& totals) {
  if (!quiet_) {
    const std::string text = status_text(totals, before_, seconds(now - shown_), total_);
    std::fprintf(stderr, terminal_ ? "\r\033[K%s" : "%s\n", text.c_str());
    std::fflush(stderr);
    drawn_ = true;
  }
  before_ = totals;
  shown_ = now;
}

}  // namespace echofuse::acquire

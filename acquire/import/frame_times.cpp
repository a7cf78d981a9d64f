// SPDX-License-Identifier: MIT
#include "acquire/import/frame_times.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <set>
#include <utility>

#include "acquire/intake/clock_fit.hpp"

namespace echofuse::acquire {
namespace {

constexpr double tick_s = 5e-9;
constexpr std::uint64_t shortest_line = 8;
// Tolerance of a clock reading, in addition to half a period: the transmission of the previous
// frame may delay it.
constexpr double late_s = 0.02, other_rate = 5e-4;

std::string fixed(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f", value);
  return text;
}

// A frame that is not a copy.
struct Entry {
  std::size_t frame;  // index of the frame in the recording
  FrameHeader header;
  std::uint32_t epoch = 0;  // number of restarts of the board before the frame
  bool stands = false;      // true: the clock shows the same time as in the previous frame
  std::optional<std::size_t> line{};
};

struct Line {
  std::size_t first, last;  // indices of entries
  std::uint64_t frames = 1;
  bool valid = false;
};

class Fit {
 public:
  Fit(const std::vector<FrameHeader>& frames, std::uint32_t subframes, double period_s)
      : frames_(frames), subframes_(subframes), period_s_(period_s) {
    times_.at.resize(frames.size());
    times_.copy.resize(frames.size());
  }

  FrameTimes run() {
    drop_copies();
    number();
    measure_period();
    for (std::size_t begin = 0, end = 0; begin < entries_.size(); begin = end) {
      while (end < entries_.size() && entries_[end].epoch == entries_[begin].epoch) ++end;
      find_lines(begin, end);
      set_times(begin, end);
    }
    return std::move(times_);
  }

 private:
  // A frame is a copy if it repeats the frame before it, or a later frame of the same numbering
  // than the first: a board that restarts repeats the first number.
  void drop_copies() {
    std::set<std::pair<std::uint32_t, std::uint32_t>> seen;
    std::uint32_t first = 0;
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      const FrameHeader& f = frames_[i];
      const FrameHeader* last = entries_.empty() ? nullptr : &entries_.back().header;
      const bool repeats = last && f.position == last->position && f.cycles == last->cycles;
      const bool back = last && f.position < last->position && f.position <= first;
      if (!last || back) seen.clear(), first = f.position;
      times_.copy[i] = repeats || !seen.emplace(f.position, f.cycles).second;
      times_.copies += times_.copy[i];
      if (!times_.copy[i]) entries_.push_back({i, f});
    }
  }

  // Finds restarts of the board and frames during which the clock stands still. A number that is
  // not between those of its neighbours is damaged; the number after the previous one replaces it.
  void number() {
    const std::uint32_t usual = 101 * subframes_, most = subframes_ << 20;
    for (std::size_t i = 1; i < entries_.size(); ++i) {
      Entry& e = entries_[i];
      const bool ends = i + 1 == entries_.size();
      const std::uint32_t last = entries_[i - 1].header.position;
      const std::uint32_t to_now = e.header.position - last;
      const std::uint32_t to_next = ends ? 0 : entries_[i + 1].header.position - e.header.position;
      const std::uint32_t both = to_now + to_next;
      const bool damaged = !ends && both > 1 && both <= usual && to_now > both;
      const bool restarts = !ends && !damaged && to_now >= most && to_next <= usual;
      e.epoch = entries_[i - 1].epoch + restarts;
      e.stands = !restarts && e.header.cycles == entries_[i - 1].header.cycles;
      if (damaged || (!restarts && to_now >= most)) e.header.position = last + 1;
    }
  }

  static std::uint32_t steps(const Entry& from, const Entry& to) {
    return to.header.position - from.header.position;
  }

  void measure_period() {
    std::vector<double> found;
    for (std::size_t i = 1; i < entries_.size(); ++i) {
      const Entry &a = entries_[i - 1], &b = entries_[i];
      if (a.epoch == b.epoch && !b.stands && steps(a, b) - 1 < 101 * subframes_)
        found.push_back(tick_s * (b.header.cycles - a.header.cycles) / steps(a, b));
    }
    if (found.empty()) return;
    const auto middle = found.begin() + static_cast<std::ptrdiff_t>(found.size() / 2);
    std::nth_element(found.begin(), middle, found.end());
    const double median = *middle;
    const auto near = std::ranges::count_if(
        found, [&](double s) { return std::abs(s - median) < 0.05 * median; });
    if (2 * static_cast<std::size_t>(near) >= found.size()) times_.period_s = period_s_ = median;
  }

  double clock_step_s(const Entry& from, const Entry& to) const {
    const double expected = steps(from, to) * period_s_ / tick_s;
    return tick_s *
           static_cast<double>(ticks_passed(from.header.cycles, to.header.cycles, expected, 32));
  }

  bool agree(const Entry& from, const Entry& to) const {
    const double expected_s = steps(from, to) * period_s_;
    return steps(from, to) < subframes_ << 20 &&
           std::abs(clock_step_s(from, to) - expected_s) <
               late_s + period_s_ / 2 + other_rate * expected_s;
  }

  void find_lines(std::size_t begin, std::size_t end) {
    constexpr std::size_t most_open = 16;
    lines_.clear();
    std::vector<std::size_t> open;
    const auto frames_of = [&](std::size_t k) { return lines_[k].frames; };
    for (std::size_t i = begin; i < end; ++i) {
      Entry& e = entries_[i];
      if (e.stands) continue;
      const auto fits = [&](std::size_t k) { return agree(entries_[lines_[k].last], e); };
      if (const auto it = std::ranges::find_if(open, fits); it != open.end()) {
        e.line = *it;
        lines_[*it].last = i;
        ++lines_[*it].frames;
        continue;
      }
      if (open.size() == most_open) open.erase(std::ranges::min_element(open, {}, frames_of));
      e.line = lines_.size();
      open.push_back(lines_.size());
      lines_.push_back({i, i});
    }
    std::vector<Line*> longest;
    for (Line& line : lines_) longest.push_back(&line);
    std::ranges::stable_sort(longest, std::ranges::greater(), &Line::frames);
    for (Line* line : longest)
      line->valid =
          line == longest.front() ||
          (line->frames >= shortest_line && std::ranges::none_of(lines_, [&](const Line& other) {
             return other.valid && other.first <= line->last && line->first <= other.last;
           }));
  }

  // Sets the times of an epoch. The time between the last frame of the previous epoch and the first
  // frame is not known; a frame period is used.
  void set_times(std::size_t begin, std::size_t end) {
    HostTime start{};
    if (begin > 0) {
      start = last_at_ + from_seconds(period_s_ * subframes_);
      times_.restarts.add("between frames " + name(begin - 1) + " and " + name(begin) + " at " +
                          fixed(seconds(last_at_)) + " s");
    }
    std::optional<std::size_t> valid;
    bool stood = false;
    std::vector<HostTime> at(end - begin, start);
    for (std::size_t i = begin; i < end; ++i) {
      const Entry &e = entries_[i], &from = entries_[valid.value_or(begin)];
      const HostTime from_at = at[valid.value_or(begin) - begin];
      HostTime& now = at[i - begin];
      now = from_at + from_seconds(steps(from, e) * period_s_);
      if (e.line && lines_[*e.line].valid) {
        if (valid && from.line == e.line) {
          now = from_at + from_seconds(clock_step_s(from, e));
        } else if (valid && !stood) {
          const double step_s = tick_s * (e.header.cycles - from.header.cycles);
          now = from_at + from_seconds(step_s);
          times_.paused.add("between frames " + name(*valid) + " and " + name(i) + " at " +
                            fixed(seconds(from_at)) + " s by " + fixed(step_s) +
                            " s + n x 21.47 s");
        }
        // Numbers of frames with impossible times may be damaged, too.
        for (std::size_t k = valid.value_or(begin); k < i; ++k)
          at[k - begin] = std::min(at[k - begin], now);
        valid = i, stood = false;
      } else if (e.stands) {
        stood = true;
        times_.stood.add("frame " + name(i));
      } else {
        times_.impossible.add(
            "frame " + name(i) +
            (valid ? " after " + fixed(seconds(from_at)) + " s" : " at the start"));
      }
    }
    for (std::size_t i = begin; i < end; ++i)
      times_.at[entries_[i].frame] = last_at_ = std::max(last_at_, at[i - begin]);
  }

  std::string name(std::size_t entry) const {
    return std::to_string(entries_[entry].header.number);
  }

  const std::vector<FrameHeader>& frames_;
  std::uint32_t subframes_;
  double period_s_;
  FrameTimes times_;
  std::vector<Entry> entries_;
  std::vector<Line> lines_;  // lines in the current epoch
  HostTime last_at_{};
};

}  // namespace

void Irregularity::add(const std::string& place) {
  constexpr std::uint64_t most = 5;
  if (++count <= most + 1) places += (count == 1 ? "" : ", ") + (count <= most ? place : "...");
}

FrameTimes fit_times(const std::vector<FrameHeader>& frames, std::uint32_t subframes,
                     double period_s) {
  return Fit(frames, subframes, period_s).run();
}

}  // namespace echofuse::acquire

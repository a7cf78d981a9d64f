// SPDX-License-Identifier: MIT
#include "acquire/import/frame_times.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "acquire/intake/clock_fit.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::acquire {
namespace {

constexpr double tick_s = 1 / RadarFrame::clock_hz;
constexpr std::uint64_t shortest_chain = 8;
// Number of frames that may be damaged between two members of a chain.
constexpr std::size_t max_damaged = 32;
// Tolerance of a clock reading, in addition to half a period: the transmission of the previous
// frame may delay it.
constexpr double late_s = 0.02, other_rate = 5e-4;
// Longest time between two members of a chain: `other_rate` then allows 0.2 s.
constexpr double longest_link_s = 400;

// Shortest frame period of the demo. A clock that advances by less stands still.
constexpr double shortest_period_s = 0.3e-3;

bool stands_still(const FrameHeader& from, const FrameHeader& to) {
  return tick_s * (to.cycles - from.cycles) < shortest_period_s;
}

std::string fixed(double value) { return format("%.2f", value); }

// A frame that is not a copy.
struct Entry {
  std::size_t frame;
  FrameHeader header;
  bool clock_stopped = false;  // true: the clock stands still since the previous frame
  bool member = false;         // true: the frame belongs to a valid chain
  // The best chain that ends here: number of frames; twice this number minus the numbers of frames
  // that it leaves out and of frames in which the clock stands still; sum of the clock deviations.
  std::uint64_t length = 1;
  std::int64_t score = 2;
  double deviation_s = 0;
  std::size_t previous = 0;  // its previous and first entries
  std::size_t first = 0;
  bool by_number = false;  // true: the number is right, and the clock reading is not
  double at_s = 0;
};

class Fit {
 public:
  Fit(const std::vector<FrameHeader>& frames, std::uint32_t subframes, double period_s)
      : frames_(frames), subframes_(subframes), period_s_(period_s) {
    times_.at.resize(frames.size());
    times_.copy.resize(frames.size());
    times_.lost.resize(frames.size());
  }

  FrameTimes run() {
    drop_copies();
    if (entries_.empty()) return std::move(times_);
    measure_period();
    set_times();
    return std::move(times_);
  }

 private:
  struct Chain {
    std::size_t first, last;  // indices of entries
    std::uint64_t frames;
  };

  // A frame is a copy if it repeats the frame before it, or a later frame of the same numbering
  // than the first: a board that restarts repeats the first number, and its next number is lower
  // than the last one before the restart.
  void drop_copies() {
    std::set<std::pair<std::uint32_t, std::uint32_t>> seen;
    std::uint32_t first = 0;
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      const FrameHeader& f = frames_[i];
      const FrameHeader* last = entries_.empty() ? nullptr : &entries_.back().header;
      const bool repeats = last && f == *last;
      const bool confirmed =
          last && (i + 1 == frames_.size() || frames_[i + 1].position <= last->position);
      const bool back = last && f.position < last->position && f.position <= first && confirmed;
      if (!last || back) seen.clear(), first = f.position;
      // The first number may be damaged.
      if (seen.size() < 3) first = std::min(first, f.position);
      times_.copy[i] = repeats || !seen.emplace(f.position, f.cycles).second;
      times_.copies += times_.copy[i];
      if (times_.copy[i]) continue;
      const bool clock_stopped = last && stands_still(*last, f);
      entries_.push_back({.frame = i, .header = f, .clock_stopped = clock_stopped});
    }
  }

  static std::uint32_t steps(const Entry& from, const Entry& to) {
    return to.header.position - from.header.position;
  }
  std::uint32_t usual() const { return 101 * subframes_; }
  // A larger step between two numbers starts a new numbering.
  std::uint32_t farthest() const { return subframes_ << 20; }

  // Returns the time between two frames if the clock confirms the numbers. A constant clock
  // confirms nothing: the time then follows from the numbers.
  std::optional<double> link_s(const Entry& from, const Entry& to) const {
    const std::uint32_t count = steps(from, to);
    if (count == 0 || count >= farthest()) return std::nullopt;
    const double expected_s = count * period_s_;
    if (stands_still(from.header, to.header))
      return count <= usual() ? std::optional(expected_s) : std::nullopt;
    const double passed_s =
        tick_s * static_cast<double>(
                     ticks_passed(from.header.cycles, to.header.cycles, expected_s / tick_s, 32));
    const double tolerance_s = late_s + period_s_ / 2 + other_rate * expected_s;
    return std::abs(passed_s - expected_s) < tolerance_s ? std::optional(passed_s) : std::nullopt;
  }

  // The score of a chain decreases with each frame that it leaves out, so that it does not link the
  // numbers before a restart to those after it. Of equal chains the one with clearly smaller
  // clock deviations is better, then the one that leaves out fewer frames last.
  void link_entries() {
    for (std::size_t i = 0; i < entries_.size(); ++i) {
      Entry& e = entries_[i];
      e.length = 1, e.score = 2, e.deviation_s = 0, e.previous = e.first = i, e.member = false;
      for (std::size_t back = 1; back <= std::min(i, max_damaged + 1); ++back) {
        const Entry& from = entries_[i - back];
        const double expected_s = steps(from, e) * period_s_;
        const std::int64_t score =
            from.score + 3 - static_cast<std::int64_t>(back) - e.clock_stopped;
        if (score < e.score || expected_s > longest_link_s) continue;
        const std::optional<double> link = link_s(from, e);
        if (!link) continue;
        const double deviation_s = from.deviation_s + std::abs(*link - expected_s);
        if (score == e.score && (e.length == 1 || deviation_s > e.deviation_s - late_s)) continue;
        e.length = from.length + 1, e.score = score, e.deviation_s = deviation_s;
        e.previous = i - back, e.first = from.first;
      }
    }
  }

  bool renumbers(const Entry& before, const Entry& after) const {
    return steps(before, after) - 1 >= farthest();
  }

  // Returns true if the clock has advanced by one period for each entry.
  bool continues(std::size_t from, std::size_t to) const {
    const double passed_s = tick_s * (entries_[to].header.cycles - entries_[from].header.cycles);
    const double expected_s = static_cast<double>(to - from) * period_s_;
    return std::abs(passed_s - expected_s) <= late_s + period_s_ / 2;
  }

  // A shorter chain is valid if it continues the chain before it, or if the numbering starts again
  // before or after it. A clock that continues shows that the numbers are damaged instead.
  bool confirmed(const Chain& chain, const Chain* before, const Chain* after) const {
    if (!before)
      return after && renumbers(entries_[chain.last], entries_[after->first]) &&
             !continues(chain.last, after->first);
    const Entry &last = entries_[before->last], &first = entries_[chain.first];
    if (!renumbers(last, first))
      return steps(last, first) * period_s_ <= longest_link_s && link_s(last, first).has_value();
    return !continues(before->last, chain.first) &&
           (!after || renumbers(last, entries_[after->first]));
  }

  void find_chains() {
    link_entries();
    std::vector<Chain> found;
    std::map<std::size_t, std::size_t> best;  // last entry of the best chain, by the first one
    const auto quality = [&](std::size_t i) {
      return std::pair(entries_[i].score, -entries_[i].deviation_s);
    };
    for (std::size_t i = 0; i < entries_.size(); ++i)
      if (auto& [first, last] = *best.try_emplace(entries_[i].first, i).first;
          quality(i) > quality(last))
        last = i;
    for (const auto& [first, last] : best) found.push_back({first, last, entries_[last].length});
    std::ranges::stable_sort(found, std::ranges::greater(), &Chain::frames);
    chains_.clear();
    for (const Chain& chain : found) {
      const auto next = std::ranges::upper_bound(chains_, chain.first, {}, &Chain::first);
      const Chain* after = next == chains_.end() ? nullptr : &*next;
      const Chain* before = next == chains_.begin() ? nullptr : &*std::prev(next);
      if ((before && before->last > chain.first) || (after && after->first < chain.last)) continue;
      if (chains_.empty() || chain.frames >= shortest_chain ||
          (chain.frames > 1 && confirmed(chain, before, after)))
        chains_.insert(next, chain);
    }
    for (const Chain& chain : chains_)
      for (std::size_t i = chain.last;; i = entries_[i].previous) {
        entries_[i].member = true;
        if (i == chain.first) break;
      }
  }

  std::uint64_t members() const {
    std::uint64_t sum = 0;
    for (const Chain& chain : chains_) sum += chain.frames;
    return sum;
  }

  // Clock steps per number between entries at which the clock has advanced, s, in increasing
  // order.
  std::vector<double> found_periods(bool of_members) const {
    std::vector<double> out;
    for (std::size_t i = 1, last = 0; i < entries_.size(); ++i) {
      if (entries_[i].clock_stopped) continue;
      const std::size_t before = std::exchange(last, i);
      const Entry &a = entries_[before], &b = entries_[i];
      if (steps(a, b) - 1 < usual() &&
          (!of_members || (a.member && b.member && b.previous == before)))
        out.push_back(tick_s * (b.header.cycles - a.header.cycles) / steps(a, b));
    }
    std::ranges::sort(out);
    return out;
  }

  void measure_period() {
    find_chains();
    const double stated_s = period_s_;
    const std::uint64_t as_stated = members();
    const std::vector<double> all = found_periods(false);
    std::ptrdiff_t longest = 0;
    for (auto end = all.begin(), begin = all.begin(); end != all.end(); ++end) {
      while (*begin < 0.95 * *end) ++begin;
      if (end - begin >= longest) longest = end - begin, period_s_ = *(begin + longest / 2);
    }
    find_chains();
    if (members() <= as_stated) period_s_ = stated_s, find_chains();
    if (const std::vector<double> steps_s = found_periods(true); !steps_s.empty()) {
      times_.period_s = period_s_ = steps_s[steps_s.size() / 2];
      find_chains();
    }
  }

  // Sets the times of the entries between `member` and `next`, in order of their distance from
  // `member`. Without `next` they are beyond all members, after `member` or before it (`sign` -1,
  // modulo 2^32). A number fits if it leaves room for the entries that follow. Beyond all members,
  // the next number must confirm that frames are missing, and the nearer of two times is used.
  void place(const Entry& member, const std::vector<Entry*>& entries, const Entry* next,
             std::uint32_t sign = 1) {
    const auto number_of = [&](const Entry& e) { return std::int64_t{sign * steps(member, e)}; };
    const double limit_s = next ? next->at_s - member.at_s : HUGE_VAL;
    std::int64_t at = 0;
    double passed_s = 0;
    for (std::size_t i = 0; i < entries.size(); ++i) {
      Entry& e = *entries[i];
      const auto left = static_cast<std::int64_t>(entries.size() - i);
      const std::int64_t number = number_of(e);
      const std::int64_t following = left > 1 ? number_of(*entries[i + 1]) : number;
      const bool confirmed =
          number - at <= usual() && following > number && following - number <= usual();
      const bool fits =
          number > at && (next ? number + left <= number_of(*next) : number == at + 1 || confirmed);
      const double number_s = static_cast<double>(number) * period_s_;
      const double clock_s = tick_s * (sign * (e.header.cycles - member.header.cycles));
      const bool by_clock = !e.clock_stopped && clock_s > passed_s &&
                            clock_s < (next ? limit_s : passed_s + 1.5 * period_s_) &&
                            (!fits || (!next && clock_s < number_s));
      if (by_clock)
        at = std::max<std::int64_t>(at + 1, std::llround(clock_s / period_s_));
      else
        at = fits ? number : at + 1;
      if (next) at = std::min(at, number_of(*next));
      passed_s = std::min(by_clock ? clock_s : static_cast<double>(at) * period_s_, limit_s);
      e.at_s = sign == 1 ? member.at_s + passed_s : member.at_s - passed_s;
      e.by_number = fits && !by_clock;
    }
  }

  std::vector<Entry*> entries_between(std::size_t begin, std::size_t end) {
    std::vector<Entry*> out;
    for (std::size_t i = begin; i < end; ++i) out.push_back(&entries_[i]);
    return out;
  }

  // Sets the time of a chain's first frame. The time between the last frame before a restart and
  // the first one after it is not known; a frame period is used.
  void join(std::size_t last, std::size_t first) {
    Entry &to = entries_[first], &from = entries_[last];
    if (renumbers(from, to)) {
      place(from, entries_between(last + 1, first), nullptr);
      const Entry& before = entries_[first - 1];
      to.at_s = before.at_s + period_s_ * subframes_;
      times_.restarts.add("between frames " + name(before) + " and " + name(to) + " at " +
                          fixed(before.at_s) + " s");
      return;
    }
    const std::optional<double> link = link_s(from, to);
    const double step_s = link                 ? *link
                          : from.clock_stopped ? steps(from, to) * period_s_
                                               : tick_s * (to.header.cycles - from.header.cycles);
    to.at_s = from.at_s + step_s;
    if (!link && !from.clock_stopped)
      times_.paused.add("between frames " + name(from) + " and " + name(to) + " at " +
                        fixed(from.at_s) + " s by " + fixed(step_s) + " s + n x 21.47 s");
    place(from, entries_between(last + 1, first), &to);
    const std::size_t found = first - last;  // frames, including `to`
    if (steps(from, to) > found)
      times_.lost[to.frame] = (steps(from, to) - static_cast<std::uint32_t>(found)) / subframes_;
  }

  void set_times() {
    const auto is_first = std::ranges::find_if(entries_, &Entry::member);
    auto last = static_cast<std::size_t>(is_first - entries_.begin());
    std::vector<Entry*> start = entries_between(0, last);
    std::ranges::reverse(start);
    place(entries_[last], start, nullptr, ~0u);
    const double start_s = entries_.front().at_s;
    for (std::size_t i = 0; i <= last; ++i) entries_[i].at_s -= start_s;
    for (std::size_t i = last + 1; i < entries_.size(); ++i)
      if (entries_[i].member) join(std::exchange(last, i), i);
    place(entries_[last], entries_between(last + 1, entries_.size()), nullptr);
    HostTime at{};
    std::string where = " at the start";
    for (const Entry& e : entries_) {
      if (e.member)
        where = " after " + fixed(e.at_s) + " s";
      else if (!e.clock_stopped)
        (e.by_number ? times_.times : times_.numbers).add("frame " + name(e) + where);
      if (e.clock_stopped) times_.stopped.add("frame " + name(e));
      times_.at[e.frame] = at = std::max(at, HostTime(from_seconds(e.at_s)));
    }
  }

  static std::string name(const Entry& e) { return std::to_string(e.header.number); }

  const std::vector<FrameHeader>& frames_;
  std::uint32_t subframes_;
  double period_s_;
  FrameTimes times_;
  std::vector<Entry> entries_;
  std::vector<Chain> chains_;  // valid chains, in the order of the recording
};

}  // namespace

void Irregularity::add(const std::string& place) {
  constexpr std::uint64_t max_places = 5;
  if (++count <= max_places + 1)
    places += (count == 1 ? "" : ", ") + (count <= max_places ? place : "...");
}

std::vector<std::string> FrameTimes::doubts() const {
  std::vector<std::string> out;
  const auto add = [&](const Irregularity& oddity, const std::string& what,
                       const std::string& then) {
    if (oddity.count > 0)
      out.push_back(std::to_string(oddity.count) + what + " (" + oddity.places + ")" + then);
  };
  add(restarts, " restarts of the board", ": the gaps have unknown length and are omitted");
  add(paused, " gaps in which the board's clock may have wrapped",
      ": their lengths are ambiguous; the shortest possible ones are used");
  if (unnumbered)
    out.emplace_back(
        "the frames have neither number nor time: their times are computed from their order; lost "
        "frames cannot be detected");
  else if (stopped.count > 0)
    out.push_back("the board's clock stands still in " + std::to_string(stopped.count) +
                  " frames (" + stopped.places +
                  "): their times are computed from the frame numbers");
  add(times, " frames have impossible times", ": their times are computed from the frame numbers");
  add(numbers, " frames have impossible numbers",
      ": their times are computed from the clock or the neighbouring frames");
  if (copies > 0) out.push_back(std::to_string(copies) + " duplicate frames were omitted");
  return out;
}

FrameTimes fit_times(const std::vector<FrameHeader>& frames, std::uint32_t subframes,
                     double period_s) {
  return Fit(frames, subframes, period_s).run();
}

}  // namespace echofuse::acquire

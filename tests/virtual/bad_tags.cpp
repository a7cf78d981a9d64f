// SPDX-License-Identifier: MIT
// Tests that faults in the tag stream become events and verdicts of the run, in virtual time.

#include <map>

#include "bench.hpp"

using namespace std::chrono_literals;
using namespace echofuse::test;

namespace {

constexpr std::int64_t ps = 1, ns = 1000 * ps, us = 1000 * ns, s = 1'000'000 * us;
constexpr std::int64_t period = 250 * us;

Tag tag(std::int32_t channel, std::int64_t time, TagType type = TagType::time_tag) {
  return {.type = type, .channel = channel, .time_ps = time};
}

std::int64_t click_after(std::int64_t i) { return 20 * ns + (i * 7919) % 300 - 150; }

// Stream of start pulses at 4 kHz. A click follows each 25th start.
struct Stream {
  std::function<std::int64_t(std::int64_t)> time = [](std::int64_t t) { return t; };
  // From pulse 20'000 on: delays of a second start and of a second click (0: none), and the number
  // of starts in ten that are missing.
  std::int64_t second_start = 0, second_click = 0;
  unsigned missing = 0;
  std::map<std::int64_t, TagType> others{};  // tags of other types before these pulses
  // Replaces put() if set.
  std::function<void(std::vector<Tag>& out, std::int64_t i, std::int64_t at)> pulse{};
  mutable std::mt19937 random{1};

  // Appends the tags of pulse number `i`, which is emitted at time `at`, to `out`.
  void put(std::vector<Tag>& out, std::int64_t i, std::int64_t at) const {
    if (pulse) return pulse(out, i, at);
    const bool faulty = i >= 20'000, click = i % 25 == 0;
    if (const auto other = others.find(i); other != others.end())
      out.push_back(tag(0, at, other->second));
    if (!faulty || random() % 10 >= missing) out.push_back(tag(1, at));
    if (faulty && second_start > 0) out.push_back(tag(1, at + second_start));
    if (click) out.push_back(tag(2, at + click_after(i)));
    if (click && faulty && second_click > 0)
      out.push_back(tag(2, at + click_after(i) + second_click));
    std::ranges::stable_sort(out, {}, &Tag::time_ps);
  }
};

struct Outcome {
  Strings events;
  std::vector<record::FusedRecord> records;
  bool reported(const std::string& part) const {
    return std::ranges::any_of(events, [&](const auto& e) { return e.find(part) != e.npos; });
  }
  std::string verdict(std::size_t i) const { return test::verdict(records.at(i), Sensor::spd); }
};

// Records a run with a tagger that sends the stream through the bridge protocol.
Outcome run_of(const Stream& stream, const Strings& settings = {}) {
  Bench b({.window_s = 1, .assignments = "[signal]\nspd_clicks = 10\n"});
  b.lab->set({"radar.cli=", "radar.data=", "depth.address=", "tdc.first_bin_ps=13343",
              "tdc.bins=336", "tdc.bin_width_ps=100"});
  for (const auto& setting : settings) b.lab->set({setting}, false);
  auto& loop = b.lab->loop;
  HostTime began{};
  std::int64_t pulse = 0;
  BridgedDevice tagger(
      loop, R"({"model":"Tagger","serial":"T1","firmware":"1"})", [&](BridgedDevice& device) {
        if (device.number() == 1) began = loop.now() - 50ms, pulse = 0;
        std::vector<Tag> tags;
        const std::int64_t end = (loop.now() - began).count() * ns / period;
        for (; pulse < end; ++pulse) stream.put(tags, pulse, pulse * period);
        for (Tag& t : tags) t.time_ps = stream.time(t.time_ps);
        const auto* bytes = reinterpret_cast<const std::uint8_t*>(tags.data());
        if (!tags.empty())
          device.send(sim::BlockKind::tags, Bytes(bytes, bytes + tags.size() * sizeof(Tag)));
      });
  loop.ports[b.lab->config().tdc.address] = tagger.listener.opener();
  b.record(10);
  Strings events = b.events("spd");
  // Removes the events that report verdicts.
  std::erase_if(events, [](const auto& e) { return e.starts_with("record "); });
  return {events, b.records()};
}

}  // namespace

TEST_CASE("a tag stream without faults causes no event, and each fault an event that names it") {
  struct Row {
    Stream stream;
    Strings parts;      // texts in the first event; empty: the stream causes no event
    bool only = false;  // true: the first event is the only one
  };
  const auto in_steps_of = [](std::int64_t step) {
    return [step](std::int64_t t) { return t / step * step; };
  };
  const std::string uneven = "have uneven widths; use --set tdc.bin_width_ps=";
  const Row rows[] = {
      {{}, {}},
      // A conditional filter passes only starts followed by a click.
      {{.pulse =
            [random = std::mt19937(1)](auto& out, std::int64_t i, std::int64_t at) mutable {
              if (random() % 5 > 0) return;
              out.push_back(tag(1, at));
              out.push_back(tag(2, at + click_after(i)));
            }},
       {}},
      {{.time = [](std::int64_t t) { return t % (3 * s); }},
       {"1 backward steps of the tagger's time by up to 3 s"}},
      {{.others = {{16'000, static_cast<TagType>(9)}}},
       {"1 tags with an unknown type or a nonzero reserved byte"}},
      {{.missing = 3}, {"start pulses are missing, ", "of several periods of 250 us"}},
      {{.second_start = 12 * ns}, {"starts followed by a second start after 12 ns"}},
      // The pulse rate changes within a 1 s interval. The interval that contains the change must
      // not be reported as having missing starts.
      {{.second_start = period / 2}, {"changes of the start rate, from 4 kHz to 8 kHz"}, true},
      {{.time = in_steps_of(81)}, {uneven + "81"}, true},
      {{.time = in_steps_of(250)}, {uneven + "250"}, true},
      {{.second_click = 15 * ns},
       {"clicks are followed by a second click after 15 ns",
        "a second peak 2.25 m behind the first"}}};
  for (const Row& row : rows) {
    const Outcome run = run_of(row.stream);
    CAPTURE(row.parts, run.events);
    CHECK(run.events.empty() == row.parts.empty());
    CHECK((!row.only || run.events.size() <= 1));
    for (const std::string& part : row.parts) CHECK_THAT(run.events.at(0), Catch::Contains(part));
    CHECK(run.records.at(4).has(Sensor::spd));
    if (row.parts.empty() && !row.stream.pulse)
      for (const auto& r : run.records) CHECK(verdict(r, Sensor::spd) == "ok");
  }
}

TEST_CASE("tag times that wrap are unwrapped and cause an event") {
  const int bits = GENERATE(32, 40);
  const Outcome run =
      run_of({.time = [=](std::int64_t t) { return t % (std::int64_t{1} << bits); }});
  CHECK(run.events.size() == 2);  // one event when the wrap is detected, and one event with the
                                  // count at the end of the run
  CHECK_THAT(run.events.at(0), Catch::Contains("wrap-arounds of the tagger's time at 2^" +
                                               std::to_string(bits) + " ps"));
  for (std::size_t i = 2; i < 10; ++i) {
    CHECK(run.verdict(i) == "ok");
    CHECK(run.records[i].spd_counts.out_of_range == 0);
    CHECK(run.records[i].clocks[Sensor::spd].has_value());
  }
}

TEST_CASE("a tagger clock that drifts from the host clock is reported") {
  const auto [divisor, text] = GENERATE(table<std::int64_t, const char*>(
      {{1000, "1/1000 of the rate of the host clock"}, {2, "1/2 of"}}));
  const Outcome run = run_of({.time = [d = divisor](std::int64_t t) { return t / d; }});
  CHECK(run.reported(std::string("the tagger's clock runs at ") + text));
  for (const auto& r : run.records) {  // arrival times are used instead of tag times
    CHECK(r.has(Sensor::spd));
    CHECK_FALSE(r.clocks[Sensor::spd].has_value());
  }
}

TEST_CASE("an overflow of the tagger causes a verdict and an event only if it never ends") {
  const bool ends = GENERATE(false, true);
  Stream stream;
  stream.others = {{16'000, TagType::overflow_begin}};
  if (ends) stream.others[18'000] = TagType::overflow_end;
  const Outcome run = run_of(stream);
  CHECK_THAT(run.verdict(9), Catch::StartsWith(ends ? "ok" : "in overflow: for "));
  CHECK(run.records[9].has(Sensor::spd) == ends);
  CHECK(run.reported("1 overflows that did not end within 3 s") == !ends);
}

TEST_CASE("records with lost start pulses are lossy if the laser rate is known") {
  const Outcome lossy = run_of({.missing = 3}, {"tdc.laser_rate_hz=4000"});
  CHECK(lossy.verdict(1) == "ok");
  CHECK(lossy.records[9].has(Sensor::spd));
  CHECK_THAT(lossy.verdict(9),
             Catch::StartsWith("lossy: ") &&
                 Catch::EndsWith(" % of the 4000 expected start pulses received"));
}

TEST_CASE("tags that are out of order across two blocks are sorted without loss") {
  // The start tag that belongs to the last click of each block arrives only in the next block.
  const Outcome run = run_of({.pulse = [](auto& out, std::int64_t i, std::int64_t at) {
    if (out.empty() && i > 0) out.push_back(tag(1, at - period));
    const bool last = (i + 1) % 200 == 0;
    if (!last) out.push_back(tag(1, at));
    if (last || i % 25 == 0) out.push_back(tag(2, at + click_after(i)));
  }});
  CHECK_THAT(run.events.at(0),
             Catch::Contains("events out of order by up to 1 us; the events were sorted"));
  for (const auto& r : run.records) {
    CHECK(r.spd_counts.out_of_range == 0);
    CHECK(r.spd_counts.starts == 4000);
  }
}

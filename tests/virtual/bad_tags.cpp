// SPDX-License-Identifier: MIT
// Tests that faults in the tag stream become events and verdicts of the run, in virtual time.

#include "bridged_device.hpp"

using namespace std::chrono_literals;
using namespace echofuse::test;

namespace {

constexpr std::int64_t ps = 1, ns = 1000 * ps, us = 1000 * ns, s = 1'000'000 * us;
constexpr std::int64_t period = 250 * us;

struct Stream {
  // Appends the tags of pulse number `i`, which is emitted at time `at`, to `out`.
  std::function<void(std::vector<Tag>& out, std::int64_t i, std::int64_t at)> pulse;
  std::function<std::int64_t(std::int64_t)> time = [](std::int64_t t) { return t; };
};

Tag tag(std::int32_t channel, std::int64_t time, TagType type = TagType::time_tag) {
  return {.type = type, .channel = channel, .time_ps = time};
}

std::int64_t click_after(std::int64_t i) { return 20 * ns + (i * 7919) % 300 - 150; }

void ordinary(std::vector<Tag>& out, std::int64_t i, std::int64_t at) {
  out.push_back(tag(1, at));
  if (i % 25 == 0) out.push_back(tag(2, at + click_after(i)));
}

struct Outcome {
  Strings events;
  std::vector<record::FusedRecord> records;
  bool reported(const std::string& part) const {
    return std::ranges::any_of(events, [&](const auto& e) { return e.find(part) != e.npos; });
  }
  std::string verdict(std::size_t i) const { return test::verdict(records.at(i), Sensor::spd); }
};

// Records a run with a tagger that sends start pulses at 4 kHz through the bridge protocol.
Outcome run_of(const Stream& stream, const std::vector<std::string>& settings = {}) {
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
        for (; pulse < end; ++pulse) stream.pulse(tags, pulse, pulse * period);
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

TEST_CASE("a tag stream that has no faults causes no event") {
  const Outcome run = run_of({.pulse = ordinary});
  CHECK(run.events == Strings{});
  for (const auto& r : run.records) CHECK(verdict(r, Sensor::spd) == "ok");
}

TEST_CASE("tag times that wrap are unwrapped and cause an event") {
  const int bits = GENERATE(32, 40);
  const Outcome run = run_of(
      {.pulse = ordinary, .time = [=](std::int64_t t) { return t % (std::int64_t{1} << bits); }});
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

TEST_CASE("backward steps in tag times are counted") {
  const Outcome run =
      run_of({.pulse = ordinary, .time = [](std::int64_t t) { return t % (3 * s); }});
  CHECK_THAT(run.events.at(0),
             Catch::Contains("1 backward steps of the tagger's time by up to 3 s"));
}

TEST_CASE("tags of an unknown type cause an event and are ignored") {
  const Outcome run = run_of({.pulse = [](auto& out, std::int64_t i, std::int64_t at) {
    if (i == 16'000) out.push_back(tag(2, at, static_cast<TagType>(9)));
    ordinary(out, i, at);
  }});
  CHECK(run.reported("1 tags with an unknown type or a nonzero reserved byte"));
  CHECK(run.records.at(4).has(Sensor::spd));
}

TEST_CASE("a tagger clock that drifts from the host clock is reported") {
  const auto [divisor, text] = GENERATE(table<std::int64_t, const char*>(
      {{1000, "1/1000 of the rate of the host clock"}, {2, "1/2 of"}}));
  const Outcome run =
      run_of({.pulse = ordinary, .time = [d = divisor](std::int64_t t) { return t / d; }});
  CHECK(run.reported(std::string("the tagger's clock runs at ") + text));
  for (const auto& r : run.records) {  // arrival times are used instead of tag times
    CHECK(r.has(Sensor::spd));
    CHECK_FALSE(r.clocks[Sensor::spd].has_value());
  }
}

TEST_CASE("a tagger overflow that never ends causes a verdict and an event") {
  const Outcome run = run_of({.pulse = [](auto& out, std::int64_t i, std::int64_t at) {
    if (i == 16'000) out.push_back(tag(0, at, TagType::overflow_begin));
    ordinary(out, i, at);
  }});
  CHECK_THAT(run.verdict(9), Catch::StartsWith("in overflow: for "));
  CHECK_FALSE(run.records[9].has(Sensor::spd));
  CHECK(run.reported("1 overflows that did not end within 3 s"));
}

TEST_CASE("a tagger overflow is not reported as endless if it ends or reports missed events") {
  const Outcome run = run_of({.pulse = [](auto& out, std::int64_t i, std::int64_t at) {
    if (i == 16'000) out.push_back(tag(0, at, TagType::overflow_begin));
    if (i == 18'000) out.push_back(tag(0, at, TagType::overflow_end));
    ordinary(out, i, at);
  }});
  CHECK_FALSE(run.reported("1 overflows"));
  CHECK(run.verdict(9) == "ok");
}

TEST_CASE("missing, doubled or too frequent start pulses each cause an event") {
  std::mt19937 random(1);
  const Outcome missing = run_of({.pulse = [&](auto& out, std::int64_t i, std::int64_t at) {
    if (random() % 10 >= 3) out.push_back(tag(1, at));
    if (i % 25 == 0) out.push_back(tag(2, at + click_after(i)));
  }});
  CHECK_THAT(missing.events.at(0), Catch::Contains("start pulses are missing, ") &&
                                       Catch::Contains("of several periods of 250 us"));
  const Outcome doubled = run_of({.pulse = [](auto& out, std::int64_t i, std::int64_t at) {
    out.push_back(tag(1, at));
    if (i > 20'000) out.push_back(tag(1, at + 12 * ns));
    if (i % 25 == 0) out.push_back(tag(2, at + click_after(i)));
  }});
  CHECK_THAT(doubled.events.at(0),
             Catch::Contains("starts followed by a second start after 12 ns"));
  const Outcome faster = run_of({.pulse = [](auto& out, std::int64_t i, std::int64_t at) {
    ordinary(out, i, at);
    if (i > 20'000) out.push_back(tag(1, at + period / 2));
  }});
  CHECK_THAT(faster.events.at(0),
             Catch::Contains("changes of the start rate, from 4 kHz to 8 kHz"));
  // The pulse rate changes within a 1 s interval. The interval that contains the change must not be
  // reported as having missing starts.
  CHECK(faster.events.size() == 1);
}

TEST_CASE("records with lost start pulses are lossy if the laser rate is known") {
  std::mt19937 random(1);
  const Outcome lossy = run_of({.pulse =
                                    [&](auto& out, std::int64_t i, std::int64_t at) {
                                      if (i < 20'000 || random() % 10 >= 3)
                                        out.push_back(tag(1, at));
                                      if (i % 25 == 0) out.push_back(tag(2, at + click_after(i)));
                                    }},
                               {"tdc.laser_rate_hz=4000"});
  CHECK(lossy.verdict(1) == "ok");
  CHECK(lossy.records[9].has(Sensor::spd));
  CHECK_THAT(lossy.verdict(9),
             Catch::StartsWith("lossy: ") &&
                 Catch::EndsWith(" % of the 4000 expected start pulses received"));
}

TEST_CASE("a conditional filter that passes only starts followed by a click causes no event") {
  std::mt19937 random(1);
  const Outcome run = run_of({.pulse = [&](auto& out, std::int64_t i, std::int64_t at) {
    if (random() % 5 > 0) return;
    out.push_back(tag(1, at));
    out.push_back(tag(2, at + click_after(i)));
  }});
  CHECK(run.events == Strings{});
}

TEST_CASE(
    "a tag resolution that does not divide the bin width causes an event with a suitable width") {
  const auto [step, fits] = GENERATE(table<std::int64_t, const char*>({{81, "81"}, {250, "250"}}));
  const Outcome run =
      run_of({.pulse = ordinary, .time = [d = step](std::int64_t t) { return t / d * d; }});
  CAPTURE(run.events);
  REQUIRE(run.events.size() == 1);
  CHECK_THAT(run.events[0], Catch::Contains("have uneven widths; use --set tdc.bin_width_ps=" +
                                            std::string(fits)));
}

TEST_CASE("afterpulses cause an event that reports the second peak") {
  const Outcome run = run_of({.pulse = [](auto& out, std::int64_t i, std::int64_t at) {
    ordinary(out, i, at);
    if (i % 25 == 0) out.push_back(tag(2, at + click_after(i) + 15 * ns));
  }});
  CHECK_THAT(run.events.at(0),
             Catch::Contains("clicks are followed by a second click after 15 ns, "
                             "which causes a second peak 2.25 m behind the first"));
}

TEST_CASE("tags that are out of order across two blocks are sorted without loss") {
  // The start tag that belongs to the last click of each block arrives only in the next block.
  const Outcome run = run_of({.pulse = [](auto& out, std::int64_t i, std::int64_t at) {
    if (out.empty() && i > 0) out.push_back(tag(1, at - period));
    if ((i + 1) % 200 == 0) {
      out.push_back(tag(2, at + click_after(i)));
      return;
    }
    ordinary(out, i, at);
  }});
  CHECK_THAT(run.events.at(0),
             Catch::Contains("events out of order by up to 1 us; the events were sorted"));
  for (const auto& r : run.records) {
    CHECK(r.spd_counts.out_of_range == 0);
    CHECK(r.spd_counts.starts == 4000);
  }
}

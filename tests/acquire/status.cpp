// SPDX-License-Identifier: MIT
#include "acquire/run/status.hpp"

#include "../catch.hpp"
#include "../fixtures/record.hpp"

using namespace echofuse::acquire;

namespace {

struct Moment {
  Moment() {
    now.records = 7;
    now.written = 6;
    now.valid = SensorSet::from_bits(5);
    now.doubtful = SensorSet::from_bits(3);
    now.trouble = "spd weak";
    now.rate_hz = {1.2e6, 20, 29.5};
    now.lost = {12, 0, 3};
    now.label = "person";
    now.signal.spd_peak_m = 3.456;
    now.signal.radar_snr_db = 21.4;
    now.free_bytes = 12'345'678'901;
    times = {.elapsed_s = 21.9, .remaining_s = 3761, .records = 20};
  }
  std::string line(std::optional<std::size_t> columns, bool colours = false) const {
    return status_line(status_fields(now, times), columns, colours);
  }
  RunTotals now;
  StatusTimes times;
};

}  // namespace

TEST_CASE("the status line shows all values in a fixed order") {
  Moment m;
  CHECK(m.line(std::nullopt) ==
        "record 7/20  s-D  spd weak  0:21, 1:02:41 left  1.20 Mtag/s  peak 3.46 m  radar 20.0 "
        "fps "
        "21 dB  depth 29.5 fps  lost S 12 D 3  person  12 GB free  on disk 6");
  m.now = {};
  m.now.valid = SensorSet::from_bits(7);
  m.times = {};
  CHECK(m.line(std::nullopt) ==
        "record 0  SRD  0:00  0.0 ktag/s  radar 0.0 fps  depth 0.0 fps  lost 0  on disk 0");
  m.times.elapsed_s = -3;  // the time is 3 s before the start of the first slot
  CHECK(m.line(std::nullopt).find("  0:00  ") != std::string::npos);
}

TEST_CASE("a narrow status line omits its least important parts") {
  Moment m;
  CHECK(m.line(79) == "record 7/20  s-D  spd weak  0:21, 1:02:41 left  1.20 Mtag/s  lost S 12 D 3");
  for (std::size_t columns = 16; columns < 200; ++columns) {
    const std::string line = m.line(columns);
    CHECK(line.size() <= columns);
    CHECK(line.find("record 7/20  s-D") == 0);
    CHECK((columns < 26 || line.find("spd weak") != std::string::npos));
  }
  CHECK(m.line(5) == "s-D");
}

TEST_CASE("a sensor that becomes doubtful is reported once and counted in each record") {
  RunTotals totals;
  std::string heard;
  const auto take = [&](SensorSet valid, const char* spd,
                        SensorSet configured = SensorSet::from_bits(5)) {
    record::FusedRecord r;
    r.valid = valid;
    r.sync[Sensor::spd].verdict = test::verdict_of(spd);
    r.sync[Sensor::depth].verdict = test::verdict_of("ok");
    r.sync[Sensor::depth].lost = 2;
    totals.take(r, configured, [&](Sensor s, Severity severity) {
      heard += name_of(s) + std::string(severity == Severity::info ? " ok;" : " bad;");
    });
  };
  take(SensorSet::from_bits(5), "ok");
  CHECK((heard.empty() && totals.doubtful.empty() && totals.trouble.empty()));
  take(SensorSet::from_bits(5), "weak: 98 clicks");
  take(SensorSet::from_bits(5), "weak: 95 clicks");
  CHECK(heard == "spd bad;");
  CHECK((totals.doubtful == SensorSet{Sensor::spd} && totals.trouble == "spd weak"));
  take(SensorSet::from_bits(4), "no tags");
  CHECK(heard == "spd bad;spd bad;");
  CHECK(totals.trouble == "spd no tags");
  take(SensorSet::from_bits(5), "ok");
  CHECK(heard == "spd bad;spd bad;spd ok;");
  CHECK((totals.records == 5 && totals.not_ok == 3 && totals.lost[Sensor::depth] == 10));
  take(SensorSet::from_bits(4), "not configured", SensorSet::from_bits(4));
  CHECK(totals.not_ok == 3);
}

TEST_CASE(
    "a doubtful sensor is shown in red on a colour terminal, and the status line keeps its width") {
  Moment m;
  CHECK(m.line(26, true) == "record 7/20  \033[31ms-D\033[0m  \033[31mspd weak\033[0m");
  m.now.doubtful = {}, m.now.valid = SensorSet::from_bits(7), m.now.trouble.clear();
  CHECK(m.line(79, true) == m.line(79));
}

TEST_CASE("a label in the status line is escaped, and is truncated at a character boundary") {
  Moment m;
  m.now.label = "a\033[2J\n";
  CHECK(m.line(std::nullopt).find(R"(  a\x1b[2J\n  )") != std::string::npos);
  m.now.label = "abcdefghijklmnopqrstuvw\xc3\xa4xyz";  // the 24-byte limit splits a UTF-8 character
  CHECK(m.line(std::nullopt).find("  abcdefghijklmnopqrstuvw  ") != std::string::npos);
}

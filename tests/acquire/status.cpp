// SPDX-License-Identifier: MIT
#include "acquire/run/status.hpp"

#include "../catch.hpp"
#include "../fixtures/record.hpp"

using namespace echofuse::acquire;

namespace {

struct Moment {
  std::string line(std::optional<std::size_t> columns, bool colours = false) const {
    return status_line(status_fields(now, times), columns, colours);
  }
  RunTotals now{.records = 7,
                .written = 6,
                .lost = {12, 0, 1},
                .rate_hz = {1.2e6, 20, 29.5},
                .valid = SensorSet::from_bits(5),
                .doubtful = SensorSet::from_bits(3),
                .trouble = "spd weak",
                .label = "person",
                .signal = {{}, {}, 3.456, 21.4, {}, {}},
                .free_bytes = 12'345'678'901};
  StatusTimes times{.elapsed_s = 21.9, .remaining_s = 3761, .records = 20};
};

}  // namespace

TEST_CASE("the status line shows all values in a fixed order") {
  Moment m;
  CHECK(m.line(std::nullopt) ==
        "record 7/20  s-D  spd weak  0:21, 1:02:41 left  1.20 Mtag/s  peak 3.46 m  radar 20.0 fps "
        "21 dB  depth 29.5 fps  lost S 12 D 1  person  12 GB free  on disk 6");
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
  CHECK(m.line(79) == "record 7/20  s-D  spd weak  0:21, 1:02:41 left  1.20 Mtag/s  lost S 12 D 1");
  for (std::size_t columns = 16; columns < 200; ++columns) {
    const std::string line = m.line(columns);
    CHECK(line.size() <= columns);
    CHECK(line.find("record 7/20  s-D") == 0);
    CHECK((columns < 26 || line.find("spd weak") != std::string::npos));
  }
  CHECK(m.line(5) == "s-D");
}

TEST_CASE("a sensor that becomes doubtful is reported once and counted in each record") {
  struct Row {
    std::uint32_t configured, valid;
    const char *spd, *heard, *trouble;
  };
  RunTotals totals;
  for (const Row& row : {Row{5, 5, "ok", "", ""},
                         {5, 5, "weak: 98 clicks", "spd bad", "spd weak"},
                         {5, 5, "weak: 95 clicks", "", "spd weak"},
                         {5, 4, "no tags", "spd bad", "spd no tags"},
                         {5, 5, "ok", "spd ok", ""},
                         {4, 4, "not configured", "", ""}}) {
    record::FusedRecord r;
    r.valid = SensorSet::from_bits(row.valid);
    test::set_verdict(r, Sensor::spd, row.spd), test::set_verdict(r, Sensor::depth, "ok");
    r.sync[Sensor::depth].lost = 2;
    std::string heard;
    totals.take(r, SensorSet::from_bits(row.configured), [&](Sensor s, Severity severity) {
      heard += name_of(s) + std::string(severity == Severity::info ? " ok" : " bad");
    });
    CHECK(heard == row.heard);
    CHECK(totals.trouble == row.trouble);
    CHECK(totals.doubtful.contains(Sensor::spd) == (*row.trouble != '\0'));
  }
  CHECK(std::vector{totals.records, totals.not_ok} == std::vector<std::int64_t>{6, 3});
  CHECK(totals.lost[Sensor::depth] == 12);
}

TEST_CASE("a doubtful sensor is shown in red, and the status line keeps its width") {
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

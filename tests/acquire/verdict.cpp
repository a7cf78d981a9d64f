// SPDX-License-Identifier: MIT
#include "acquire/measurement/verdict.hpp"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <set>

#include "../catch.hpp"
#include "../fixtures/paths.hpp"
#include "acquire/commands/commands.hpp"

using namespace echofuse;
using namespace echofuse::record;

TEST_CASE("the table of verdicts has one row per kind in order, and unambiguous words") {
  std::set<std::string> words;
  std::size_t kind = 0;
  for (const VerdictRow& row : verdict_table()) {
    CAPTURE(row.word);
    CHECK(static_cast<std::size_t>(row.kind) == kind++);
    CHECK(words.insert(row.word).second);
    CHECK(std::string(row.word).find(':') == std::string::npos);
    // Data that are not valid are never used. Good data are not doubtful.
    if (!row.valid) CHECK_FALSE((row.trains || row.truth));
    if (!row.trains && row.valid) CHECK(row.doubtful);
    const Verdict verdict{row.kind, "3 of 7: a figure"};
    CHECK(verdict_of(verdict.text()).text() == verdict.text());
    if (row.kind != VerdictKind::other) CHECK(verdict_of(verdict.text()) == verdict);
  }
}

TEST_CASE("a verdict of version 0.3 gets its kind, and an unknown one keeps its text") {
  CHECK(verdict_of("tags cover only 7 % of the slot").kind == VerdictKind::covers_part);
  CHECK(verdict_of("no start tags on channel 3").kind == VerdictKind::no_starts);
  CHECK(verdict_of("dropped: disk too slow").kind == VerdictKind::not_stored);
  const Verdict unknown = verdict_of("too green: 7 %");
  CHECK(unknown.kind == VerdictKind::other);
  CHECK(unknown.text() == "too green: 7 %");
}

TEST_CASE("of two verdicts the higher rank is kept, and the other one stays in the figures") {
  const Verdict no_peak{VerdictKind::no_peak, "2 dB"}, lossy{VerdictKind::lossy, "40 %"};
  for (const bool swapped : {false, true}) {
    Verdict both = swapped ? lossy : no_peak;
    both.add(swapped ? no_peak : lossy);
    CHECK(both.kind == VerdictKind::lossy);
    CHECK(both.text() == "lossy: 40 %; also no peak: 2 dB");
  }
  Verdict one{VerdictKind::ok, {}};
  one.add(no_peak);
  CHECK(one == no_peak);
  one.add({VerdictKind::ok, {}});
  CHECK(one == no_peak);
}

TEST_CASE("the manual contains the table printed by `echofuse-acquire verdicts`") {
  std::ifstream file(test::source_dir + "/acquire/README.md");
  const std::string manual{std::istreambuf_iterator<char>(file), {}};
  CHECK(manual.find(acquire::describe_verdicts(false)) != std::string::npos);
}

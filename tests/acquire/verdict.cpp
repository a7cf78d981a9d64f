// SPDX-License-Identifier: MIT
#include "acquire/measurement/verdict.hpp"

#include <set>

#include "../fixtures/folder.hpp"
#include "../fixtures/paths.hpp"
#include "acquire/commands/commands.hpp"

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
    CHECK(kind_of(row.word) == row.kind);
  }
  CHECK(kind_of("too green") == VerdictKind::other);
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

TEST_CASE("the manual and the Python package contain the table of `echofuse-acquire verdicts`") {
  using test::contents, test::source_dir;
  CHECK(contents(source_dir + "/acquire/RECORDS.md").find(acquire::describe_verdicts(false)) !=
        std::string::npos);
  CHECK(contents(source_dir + "/recon/python/echofuse/runs/verdicts.json") ==
        acquire::describe_verdicts(true));
}

// SPDX-License-Identifier: MIT
// A long run in parts: no slot is lost between two of them, and the programs take them as one run.
#include <nlohmann/json.hpp>

#include "../acquire/testing.hpp"
#include "acquire/record/run_parts.hpp"
#include "bench.hpp"
#include "recon/view/followed_run.hpp"

using namespace echofuse;
using test::Bench;
using namespace std::chrono_literals;

namespace {

acquire::RunOptions in_parts(const Bench& b, std::int64_t count, std::int64_t part_records) {
  acquire::RunOptions run = b.run(count);
  run.out = record::part_path(b.folder / "run.sqlite", 1);
  run.part_records = part_records;
  return run;
}

std::vector<record::FusedRecord> records_of(const std::vector<std::string>& files) {
  std::vector<record::FusedRecord> all;
  for (const auto& file : files)
    record::RunReader(file).for_each(
        [&](const record::FusedRecord& r) { return all.push_back(r), true; });
  return all;
}

std::vector<std::int64_t> sizes_of(const std::vector<std::string>& files) {
  std::vector<std::int64_t> out;
  for (const auto& file : files) out.push_back(record::RunReader(file).count());
  return out;
}

testing::Outcome program(const std::string& command) {
  return testing::shell(test::bin_dir + "/" + command);
}

}  // namespace

TEST_CASE("a run in parts has the records of one in one file, and each part what reads need") {
  Bench whole, b;
  CHECK(whole.lab->record(whole.run(10)) == ExitCode::ok);
  CHECK(b.lab->record(in_parts(b, 10, 4)) == ExitCode::ok);
  const auto files = record::files_of(b.folder / "run").paths;
  REQUIRE(sizes_of(files) == std::vector<std::int64_t>{4, 4, 2});
  const auto expected = whole.records(), found = records_of(files);
  REQUIRE(found.size() == 10);
  for (std::size_t k = 0; k < found.size(); ++k) {
    CHECK(found[k].index == static_cast<std::int64_t>(k));
    CHECK(found[k].slot_start == found[0].slot_start + static_cast<std::int64_t>(k) * 3s);
    CHECK(found[k].slot_utc == expected[k].slot_utc);
    CHECK(found[k].valid == expected[k].valid);
    CHECK(found[k].spd == expected[k].spd);
    CHECK(found[k].radar == expected[k].radar);
    CHECK(found[k].depth_mm == expected[k].depth_mm);
  }
  const record::RunReader first(files[0]);
  for (const auto& file : files) {
    const record::RunReader part(file);
    CHECK(part.info().uuid == first.info().uuid);
    CHECK(part.info().status == "complete");
    CHECK(part.info().config_resolved == first.info().config_resolved);
    CHECK(part.axes().size() == first.axes().size());
    CHECK(part.devices().size() == 3);
    CHECK(part.calibrations() == first.calibrations());
    CHECK(part.policies() == first.policies());
    CHECK(part.anchors().size() > 0);
  }
  CHECK(record::RunReader(files[2]).counters().size() > 0);
}

TEST_CASE("a run whose last part is full has no empty one behind it") {
  Bench b;
  CHECK(b.lab->record(in_parts(b, 8, 4)) == ExitCode::ok);
  CHECK(sizes_of(record::files_of(b.folder / "run").paths) == std::vector<std::int64_t>{4, 4});
}

TEST_CASE("a run in parts is resumed in its last part, which fills before the next one begins") {
  Bench b;
  CHECK(b.lab->record(in_parts(b, 6, 4)) == ExitCode::ok);
  const auto go_on = [&](const std::string& part, std::int64_t count) {
    acquire::RunOptions run = b.run(count);
    run.out = part;
    run.resume = true;
    return b.lab->record(run);
  };
  auto files = record::files_of(b.folder / "run").paths;
  CHECK_THROWS_WITH(go_on(files[0], 1), Catch::Contains("is not the last part of its run"));
  CHECK(go_on(files[1], 2) == ExitCode::ok);  // full
  CHECK(go_on(files[1], 5) == ExitCode::ok);
  files = record::files_of(b.folder / "run").paths;
  CHECK(sizes_of(files) == std::vector<std::int64_t>{4, 4, 4, 1});
  const auto gaps = [&](const std::string& file) {
    std::string all;
    for (const auto& e : record::RunReader(file).events())
      if (e.text.starts_with("resumed")) all += e.text.substr(0, e.text.find(',')) + '\n';
    return all;
  };
  CHECK(gaps(files[1]) == "resumed at record 6\n");  // full then: the next gap is of the next part
  CHECK(gaps(files[2]) == "resumed at record 8\n");
  const auto all = records_of(files);
  for (std::size_t k = 0; k < all.size(); ++k) CHECK(all[k].index == static_cast<std::int64_t>(k));
}

TEST_CASE("a part that was killed before its first record goes on where the run was") {
  Bench b;
  b.lab->set({"run.label=lamp on"});
  CHECK(b.lab->record(in_parts(b, 8, 4)) == ExitCode::ok);
  b.lab->set({"run.label=lamp off"});
  const auto before = record::files_of(b.folder / "run").paths;
  static_cast<void>(record::next_part(before.back(), 3, 8, system_clock));  // never closed
  CHECK(record::RunReader(before.back()).calibrations() ==
        record::RunReader(before.front()).calibrations());
  acquire::RunOptions run = b.run(6);
  run.out = record::files_of(b.folder / "run").paths.back();
  run.resume = true;
  CHECK(b.lab->record(run) == ExitCode::ok);
  const auto files = record::files_of(b.folder / "run").paths;
  CHECK(sizes_of(files) == std::vector<std::int64_t>{4, 4, 4, 2});
  const auto all = records_of(files);
  REQUIRE(all.size() == 14);
  for (std::size_t k = 0; k < all.size(); ++k) CHECK(all[k].index == static_cast<std::int64_t>(k));
  for (const auto& r : all) CHECK(r.label == "lamp on");
}

TEST_CASE("the programs take the parts of a run as one") {
  Bench b({.hold_s = 3});
  CHECK(b.lab->record(in_parts(b, 60, 25)) == ExitCode::ok);
  const std::string run = b.folder / "run", model = b.folder / "m.safetensors";
  const auto listed = program("echofuse-acquire list --json " + b.folder / "");
  CAPTURE(listed.text);
  const auto runs = nlohmann::json::parse(listed.text);
  REQUIRE(runs.size() == 1);
  CHECK(runs[0]["name"] == "run");
  CHECK(runs[0]["records"] == 60);
  CHECK(runs[0]["length_s"] == 180);
  for (const std::string& shown : {run, b.folder / ""}) {
    view::FollowedRun view(shown);
    CHECK(view.refresh());
    CHECK(view.outlines().size() == 60);
    CHECK(view.last() == 59);
  }
  const auto trained =
      program("echofuse-recon train --model mean-shape " + run + " --out " + model);
  CAPTURE(trained.text);
  REQUIRE(trained.code == 0);
  CHECK(program("echofuse-recon evaluate --all " + model + " " + run).code == 0);
  const auto made =
      program("echofuse-recon reconstruct " + model + " " + run + " --out " + b.folder / "maps");
  CHECK(testing::has(made.text, "60 records reconstructed, 0 left out"));
  const auto followed = program("echofuse-recon reconstruct --follow -q " + model + " " + run +
                                " --out " + b.folder / "followed");
  CHECK(testing::shell("cd " + b.folder / "" +
                       " && cut -d, -f1,2 maps/records.csv > a && cut "
                       "-d, -f1,2 followed/records.csv | diff - a")
            .code == 0);
  const auto told = program("echofuse-acquire info " + run);
  CHECK(told.code == 0);
  CHECK(testing::has(told.text, "run.sqlite: 60 records, complete"));
  CHECK(program("echofuse-acquire info " + run + "-002").code == 0);
  CHECK(program("echofuse-acquire annotate " + run + " note").code == 0);
  CHECK(record::RunReader(run + "-003.sqlite").events().back().text == "note");
  std::filesystem::remove(run + "-002.sqlite");
  for (const std::string& command :
       {"echofuse-recon evaluate --all " + model + " " + run,
        "echofuse-recon reconstruct --force " + model + " " + run + " --out " + b.folder / "maps",
        "echofuse-acquire annotate " + run + " note", "echofuse-acquire list " + b.folder / ""}) {
    const auto gap = program(command);
    CAPTURE(gap.text);
    CHECK(gap.code == 0);
    CHECK(testing::has(gap.text,
                       run + "-002.sqlite: not there, or not of this run; records 25 to 49"));
  }
  std::filesystem::remove(run + "-001.sqlite");
  CHECK(testing::has(program("echofuse-acquire run --config " + b.folder / "lab.toml" +
                             " --records 9 --out " + run)
                         .text,
                     "run-003.sqlite: exists already; parts of a run stand under its name"));
}

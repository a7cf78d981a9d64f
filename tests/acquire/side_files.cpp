// SPDX-License-Identifier: MIT
// Tests SQLite side files next to a run file: a -wal file of this run, a -wal file of another run,
// or no -wal file.
#include "acquire/record/side_files.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <csignal>

#include "acquire/commands/commands.hpp"
#include "acquire/record/annotate.hpp"
#include "acquire/record/recover.hpp"
#include "testing.hpp"

using namespace echofuse::record;

// Writes a run. Starts a transaction with journal_mode=DELETE and kills the program after it has
// written some pages.
static void hot_journal(const std::string& path) {
  a_small_run(14).write(path);
  const pid_t child = fork();
  if (child == 0) {
    OtherProgram writer(path);
    writer.ask("BEGIN IMMEDIATE; UPDATE record SET spd = zeroblob(100000), label = 'x'");
    sqlite3_db_cacheflush(writer.db.get());
    ::kill(::getpid(), SIGKILL);
  }
  REQUIRE(waitpid(child, nullptr, 0) == child);
  REQUIRE(fs::file_size(path + "-journal") > 0);
}

TEST_CASE("SQLite side files next to a closed run are reported but not read") {
  const Folder folder;
  const std::string path = a_small_run(3).write(folder / "a.sqlite"), other = folder / "b.sqlite";
  const std::string kind =
      GENERATE("-wal", "-journal", "-shm", "fifo-wal", "fifo-journal", "fifo-shm");
  CAPTURE(kind);
  const std::string before = contents(path);
  const bool fifo = kind.starts_with("fifo");
  const std::string suffix = fifo ? kind.substr(4) : kind, leftover = path + suffix;
  const auto live = a_small_run(14).open(folder / "live.sqlite");
  hot_journal(other);
  if (fifo)
    REQUIRE(::mkfifo(leftover.c_str(), 0666) == 0);
  else
    fs::copy_file((suffix == "-journal" ? other : folder / "live.sqlite") + suffix, leftover);
  recover(path);
  for (const char* network : {"", "NFS"}) {
    const RunReader run(path, network);
    CHECK(run.count() == 3);
    CHECK(run.info().status == "complete");
    CHECK(run.check().empty());
    CHECK(run.leftovers() == std::vector{leftover});
  }
  CHECK(contents(path) == before);
  CHECK(side_files(path) == std::vector{leftover});
  const std::string text = leftover + ": not read, because the run is closed";
  CHECK(has(acquire::describe_run(path, false), text));
  CHECK(has(acquire::list_runs(folder.path, system_clock, false).text, text));
  fs::remove(leftover);
  CHECK(RunReader(path).leftovers().empty());
}

TEST_CASE("a copy of an open run that lacks its -wal file is refused and not changed") {
  const Folder folder;
  const std::string path = folder / "copy.sqlite";
  {
    const auto run = a_small_run(3).open(folder / "a.sqlite");
    fs::copy_file(folder / "a.sqlite", path);
    fs::copy_file(folder / "a.sqlite-wal", folder / "kept");
  }
  for (int time = 0; time < 2; ++time) {
    recover(path);
    CHECK(status_of(path) == crashed_without_wal);
    CHECK(side_files(path).empty());
    check_error(ExitCode::failed, "a copy without its -wal file",
                [&] { put_note(path, "door", "me"); });
  }
  // An empty -wal file, like the one that SQLite creates for a reader.
  write_file(path + "-wal", "");
  recover(path);
  CHECK(status_of(path) == crashed_without_wal);
  fs::remove(path + "-wal");
  CHECK(has(acquire::describe_run(path, false), "in " + path + "-wal, which is missing here"));
  fs::copy_file(folder / "kept", path + "-wal");
  CHECK(status_of(path) == "crashed");
  CHECK(RunReader(path).count() == 3);
}

TEST_CASE("a run killed near its start or its end keeps its status and has no side files") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto [meta, status] = GENERATE(table<std::string, std::string>(
      {{R"({"wal_key": "none"})", "crashed"}, {"{}", "crashed"}, {"", "complete"}}));
  CAPTURE(meta);
  if (status == "complete") {
    a_small_run(3).write(path);
    sql(path, "PRAGMA journal_mode=WAL");
  } else {
    a_small_run(0).open(folder / "b.sqlite");
    fs::rename(folder / "b.sqlite", path);
    damage(path, "open run with the metadata ?1", {meta});
  }
  write_file(path + "-wal", "");
  CHECK(status_of(path) == status);
  recover(path);
  CHECK(side_files(path).empty());
  CHECK(status_of(path) == status);
  CHECK(RunReader(path).count() == (status == "complete" ? 3 : 0));
}

// Leaves behind a run file like that of a killed program. A checkpoint after every 10 records makes
// SQLite restart the -wal file.
static void killed_run(const std::string& path, int records) {
  const auto run = a_small_run(0).open(path);
  for (int i = 0; i < records; ++i) {
    run->append(small_record(i));
    if (i % 10 == 9) sql(path, "PRAGMA wal_checkpoint(TRUNCATE)");
    if (i == 19) put_note(path, "makes the header of the -wal", "me");
  }
}

TEST_CASE("an open run is read only together with its own -wal file") {
  const Folder folder;
  const std::string path = folder / "a.sqlite", other = folder / "b.sqlite",
                    whole = folder / "whole.sqlite";
  killed_run(path, 35);
  killed_run(other, 38);
  for (const char* file : {"", "-wal"}) fs::copy_file(path + file, whole + file);
  CHECK(RunReader(whole).info().meta.empty());
  CHECK(RunReader(whole).count() == 35);
  recover(whole);
  CHECK(RunReader(whole).count() == 35);
  CHECK(sql(whole, "SELECT 1 FROM run WHERE meta LIKE '%wal_key%'").empty());

  fs::copy_file(other + "-wal", path + "-wal", fs::copy_options::overwrite_existing);
  fs::remove(path + "-shm");
  const std::string before = contents(path);
  recover(path);
  const std::string text = check_error(ExitCode::failed, path + "-wal belongs to another run (key ",
                                       [&] { RunReader run(path); });
  CHECK(error_of([&] { put_note(path, "door", "me"); }).second == text);
  CHECK(contents(path) == before);
  CHECK_FALSE(fs::exists(path + "-shm"));
  fs::remove(path + "-wal");
  CHECK(status_of(path) == crashed_without_wal);
  CHECK(RunReader(path).count() == 30);
}

TEST_CASE("an open run with the -journal file of another run is refused") {
  const Folder folder;
  const std::string path = folder / "a.sqlite", other = folder / "b.sqlite";
  killed_run(path, 5);
  hot_journal(other);
  fs::copy_file(other + "-journal", path + "-journal");
  const std::string before = contents(path);
  recover(path);
  const auto refuses = [&](const std::string& why) {
    check_error(ExitCode::failed, path + "-journal belongs to another run (" + why + ")",
                [&] { RunReader run(path); });
  };
  refuses("a run with a -wal must not have a -journal");
  fs::rename(path + "-wal", folder / "wal");
  refuses("it has more than one page");
  constexpr std::size_t sector = 512;
  std::string journal = contents(path + "-journal").substr(0, sector + 4);
  journal[sector + 3] = 2;
  write_file(path + "-journal", journal);
  refuses("it contains a page other than 1: 2");
  CHECK(contents(path) == before);
  fs::remove(path + "-journal");
  fs::rename(folder / "wal", path + "-wal");
  CHECK(RunReader(path).count() == 5);
}

// The file is in the state between the two steps of SQLite's switch to journal_mode=DELETE.
TEST_CASE("a run in WAL mode that lacks a -wal file can be read, even on read-only media") {
  const Folder folder;
  fs::create_directory(folder / "in");
  const std::string path = a_small_run(3).write(folder / "in/a.sqlite");
  std::fstream(path, std::ios::in | std::ios::out | std::ios::binary).seekp(18) << "\2\2";
  REQUIRE(::chmod(folder.path.c_str(), 0777) == 0);
  REQUIRE(::chmod((folder / "in").c_str(), 0555) == 0);
  const pid_t child = fork();
  if (child == 0) {
    constexpr uid_t nobody = 65534;
    if (::geteuid() == 0 && ::setuid(nobody) != 0) ::_exit(2);
    bool complete = false;
    error_of([&] { complete = RunReader(path).count() == 3 && status_of(path) == "complete"; });
    ::_exit(complete ? 0 : 1);
  }
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  CHECK(status == 0);
  REQUIRE(::chmod((folder / "in").c_str(), 0777) == 0);
  CHECK(RunReader(path).count() == 3);
  for (const char* beside : {"-wal", "-shm"}) CHECK_FALSE(fs::exists(path + beside));
}

TEST_CASE("closing a run accepts the tables made by ANALYZE but refuses any other extra table") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto run = a_small_run(1).open(path);
  // In the first row, no statement removes anything.
  const auto [make, statement] = GENERATE(table<std::string, std::string>(
      {{"CREATE INDEX i ON record (label); ANALYZE; DROP INDEX i", ""},
       {"CREATE TABLE \"m\"\"y\" (a)", "DROP TABLE \"m\"\"y\""},
       {"CREATE INDEX i ON record (label)", "DROP INDEX \"i\""},
       {"CREATE VIEW v AS SELECT 1", "DROP VIEW \"v\""}}));
  sql(path, make);
  run->append(small_record(1));
  const auto [code, text] = error_of([&] { run->close("complete"); });
  CHECK(code == (statement.empty() ? ExitCode::ok : ExitCode::failed));
  if (!statement.empty()) {
    CHECK(has(text, "remove it with: " + statement + " (2 records are kept)"));
    CHECK(has(error_of([&] { RunReader reader(path); }).second, statement));
  }
  CHECK_FALSE(fs::exists(path + "-wal"));
  sql(path, statement);
  CHECK(status_of(path) == "complete");
  CHECK(RunReader(path).count() == 2);
}

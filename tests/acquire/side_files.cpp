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
#include "acquire/record/sqlite.hpp"
#include "drivers/core/clock.hpp"
#include "testing.hpp"

using namespace echofuse::record;

// Starts a transaction with journal_mode=DELETE and kills the program after it has written some
// pages.
static void hot_journal(const std::string& path) {
  const pid_t child = fork();
  if (child == 0) {
    sqlite3* db = nullptr;
    sqlite3_open(path.c_str(), &db);
    sqlite3_exec(db, "BEGIN IMMEDIATE; UPDATE record SET spd = zeroblob(100000), label = 'x'",
                 nullptr, nullptr, nullptr);
    sqlite3_db_cacheflush(db);
    ::kill(::getpid(), SIGKILL);
  }
  REQUIRE(waitpid(child, nullptr, 0) == child);
  REQUIRE(fs::file_size(path + "-journal") > 0);
}

TEST_CASE("SQLite side files next to a closed run are reported but not read") {
  const Folder folder;
  const std::string path = folder / "a.sqlite", other = folder / "b.sqlite";
  const std::string kind = GENERATE("-wal", "hot -journal", "-shm", "fifo");
  CAPTURE(kind);
  a_small_run(3).write(path);
  const std::string before = contents(path);
  std::string leftover = path + "-wal";
  if (kind == "hot -journal") {
    leftover = path + "-journal";
    a_small_run(14).write(other);
    hot_journal(other);
    fs::copy_file(other + "-journal", leftover);
  } else if (kind == "fifo") {
    REQUIRE(::mkfifo(leftover.c_str(), 0666) == 0);
  } else {
    leftover = path + kind;
    const auto run = a_small_run(14).open(other);
    fs::copy_file(other + kind, leftover);
  }
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
    CHECK(RunReader(path).info().status == crashed_without_wal);
    for (const char* beside : {"-wal", "-shm"}) CHECK_FALSE(fs::exists(path + beside));
    check_error(ExitCode::failed, "a copy without its -wal file",
                [&] { put_note(path, "door", "me"); });
  }
  // An empty -wal file, like the one that SQLite creates for a reader.
  write_file(path + "-wal", "");
  recover(path);
  CHECK(RunReader(path).info().status == crashed_without_wal);
  fs::remove(path + "-wal");
  CHECK(has(acquire::describe_run(path, false),
            "its last records are in " + path + "-wal, which is missing here"));
  fs::copy_file(folder / "kept", path + "-wal");
  CHECK(RunReader(path).info().status == "crashed");
  CHECK(RunReader(path).count() == 3);
}

TEST_CASE("a run killed before its wal_key was stored is opened with the status crashed") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  for (const char* meta : {R"({"wal_key": "none"})", "{}"}) {
    CAPTURE(meta);
    a_small_run(0).open(folder / "b.sqlite");
    fs::rename(folder / "b.sqlite", path);
    damage(path, "open run with the metadata ?1", {meta});
    write_file(path + "-wal", "");
    CHECK(RunReader(path).info().status == "crashed");
    recover(path);
    CHECK(side_files(path).empty());
    CHECK(RunReader(path).info().status == "crashed");
  }
}

TEST_CASE("a run killed after its end was stored keeps its status and has no side files") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  a_small_run(3).write(path);
  sql(path, "PRAGMA journal_mode=WAL");
  write_file(path + "-wal", "");
  CHECK(RunReader(path).info().status == "complete");
  recover(path);
  CHECK(side_files(path).empty());
  CHECK(RunReader(path).info().status == "complete");
  CHECK(RunReader(path).count() == 3);
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
  const std::string path = folder / "a.sqlite", other = folder / "b.sqlite";
  killed_run(path, 35);
  killed_run(other, 38);
  fs::copy_file(path, folder / "whole.sqlite");
  fs::copy_file(path + "-wal", folder / "whole.sqlite-wal");
  CHECK(RunReader(folder / "whole.sqlite").count() == 35);
  CHECK(RunReader(folder / "whole.sqlite").info().meta.empty());
  recover(folder / "whole.sqlite");
  CHECK(RunReader(folder / "whole.sqlite").count() == 35);
  CHECK(sql(folder / "whole.sqlite",
            "SELECT 1 FROM run WHERE json_extract(meta, '$.wal_key') NOTNULL")
            .empty());

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
  CHECK(RunReader(path).info().status == crashed_without_wal);
  CHECK(RunReader(path).count() == 30);
}

TEST_CASE("an open run with the -journal file of another run is refused") {
  const Folder folder;
  const std::string path = folder / "a.sqlite", other = folder / "b.sqlite";
  killed_run(path, 5);
  a_small_run(14).write(other);
  hot_journal(other);
  fs::copy_file(other + "-journal", path + "-journal");
  const std::string before = contents(path);
  recover(path);
  const auto refusal = [&] { return error_of([&] { RunReader run(path); }).second; };
  CHECK(has(refusal(),
            path + "-journal belongs to another run (a run with a -wal must not have a -journal)"));
  fs::rename(path + "-wal", folder / "wal");
  CHECK(has(refusal(), path + "-journal belongs to another run (it has more than one page)"));
  constexpr std::size_t sector = 512;
  std::string journal = contents(path + "-journal").substr(0, sector + 4);
  journal[sector + 3] = 2;
  write_file(path + "-journal", journal);
  CHECK(has(refusal(),
            path + "-journal belongs to another run (it contains a page other than 1: 2)"));
  CHECK(contents(path) == before);
  fs::remove(path + "-journal");
  fs::rename(folder / "wal", path + "-wal");
  CHECK(RunReader(path).count() == 5);
}

// The file is in the state between the two steps of SQLite's switch to journal_mode=DELETE.
TEST_CASE("a run in WAL mode that lacks a -wal file can be read, even on read-only media") {
  const Folder folder;
  fs::create_directory(folder / "in");
  const std::string path = folder / "in/a.sqlite";
  a_small_run(3).write(path);
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(18).write("\2\2", 2);
  file.close();
  const auto all = fs::perms::owner_all | fs::perms::group_all | fs::perms::others_all;
  fs::permissions(folder.path, all);
  fs::permissions(folder / "in", all & ~(fs::perms::owner_write | fs::perms::group_write |
                                         fs::perms::others_write));
  const pid_t child = fork();
  if (child == 0) {
    constexpr uid_t nobody = 65534;
    if (::geteuid() == 0 && ::setuid(nobody) != 0) ::_exit(2);
    int code = 1;
    try {
      const RunReader run(path);
      code = run.count() == 3 && run.info().status == "complete" ? 0 : 1;
    } catch (const Error&) {
    }
    ::_exit(code);
  }
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  CHECK(status == 0);
  fs::permissions(folder / "in", all);
  CHECK(RunReader(path).count() == 3);
  for (const char* beside : {"-wal", "-shm"}) CHECK_FALSE(fs::exists(path + beside));
}

TEST_CASE("closing a run accepts the tables made by ANALYZE but refuses any other extra table") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto run = a_small_run(1).open(path);
  SECTION("tables made by ANALYZE are accepted") {
    sql(path, "CREATE INDEX i ON record (label); ANALYZE; DROP INDEX i; PRAGMA optimize");
    run->append(small_record(1));
    CHECK(run->close("complete"));
    CHECK(RunReader(path).count() == 2);
  }
  SECTION("foreign tables, indexes and views are refused at the end of the run") {
    const auto [make, statement] = GENERATE(
        table<std::string, std::string>({{"CREATE TABLE \"m\"\"y\" (a)", "DROP TABLE \"m\"\"y\""},
                                         {"CREATE INDEX i ON record (label)", "DROP INDEX \"i\""},
                                         {"CREATE VIEW v AS SELECT 1", "DROP VIEW \"v\""}}));
    sql(path, make);
    run->append(small_record(1));
    check_error(ExitCode::failed, "remove it with: " + statement + " (2 records are kept)",
                [&] { run->close("complete"); });
    CHECK(has(error_of([&] { RunReader reader(path); }).second, statement));
    CHECK_FALSE(fs::exists(path + "-wal"));
    sql(path, statement);
    CHECK(RunReader(path).info().status == "complete");
    CHECK(RunReader(path).count() == 2);
  }
}

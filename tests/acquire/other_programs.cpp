// SPDX-License-Identifier: MIT
// Tests other programs that access the files, the lock or the records of a run during recording.
#include <fcntl.h>
#include <sqlite3.h>
#include <sys/file.h>
#include <unistd.h>

#include <future>

#include "acquire/record/annotate.hpp"
#include "acquire/record/recover.hpp"
#include "acquire/record/writer_lock.hpp"
#include "testing.hpp"

using namespace echofuse::record;

namespace {

// Run that is being recorded, and the path of the copy that is made if its file is lost.
struct OpenRun {
  explicit OpenRun(std::int64_t count) : records(count) {}
  void more() { run->append(small_record(records++)); }
  // Copies the committed data from the WAL to the database, as another program may do at any time.
  void checkpoint() const { sql(path, "PRAGMA wal_checkpoint(TRUNCATE)"); }
  // Checks that closing the run fails. Returns the message.
  std::string failure_of_close(const std::string& status, const std::string& words = "") {
    return check_error(ExitCode::disk, words, [&] { run->close(status); });
  }

  const Folder folder;
  const std::string path = folder / "a.sqlite", copy = folder / "a.rescued.sqlite";
  std::int64_t records;
  std::unique_ptr<RunWriter> run = a_small_run(records).open(path);
};

// Overwrites a file from the offset `at` to its end.
void overwrite(const std::string& path, std::size_t at) {
  const std::string garbage(fs::file_size(path) - at, '\xde');
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(static_cast<std::streamoff>(at)) << garbage;
}

void check_whole(const std::string& path, std::int64_t records,
                 const std::string& status = "complete") {
  CAPTURE(path);
  const RunReader run(path);
  CHECK(run.check().empty());
  CHECK(run.info().status == status);
  REQUIRE(run.count() == records);
  for (std::int64_t i = 0; i < records; ++i) CHECK(counts(run.read(i)) == counts(small_record(i)));
}

}  // namespace

TEST_CASE("a run with a deleted or replaced file ends at the next record and is saved as a copy") {
  OpenRun open(7);
  const std::string& path = open.path;
  write_file(open.folder / "x", "");
  // Each row renames a file of the run, or replaces it, or removes it if the new name is empty.
  const auto [name, new_name, said] = GENERATE(table<std::string, std::string, std::string>(
      {{"x", "a.sqlite", "was replaced by another file"},
       {"a.sqlite", "", "was removed or renamed"},
       {"a.sqlite", "x", "was removed or renamed"},
       {"a.sqlite-wal", "", "its -wal file was removed or renamed"},
       {"x", "a.sqlite-wal", "its -wal file was replaced by another file"},
       {"a.sqlite-shm", "", "its -shm file was removed"}}));
  CAPTURE(name, new_name);
  const std::string from = open.folder / name, to = open.folder / new_name;
  if (GENERATE(false, true)) open.checkpoint();
  open.more();
  if (new_name.empty())
    fs::remove(from);
  else
    fs::rename(from, to);
  const std::string text = check_error(ExitCode::disk, path + ": " + said, [&] { open.more(); });
  CHECK(open.failure_of_close("stopped:disk") == text + "; its 8 records are in " + open.copy);
  check_whole(open.copy, 8, "stopped:disk");
  CHECK_FALSE(fs::exists(open.copy + "-wal"));
  if (!fs::exists(path) || fs::file_size(path) == 0) CHECK_FALSE(fs::exists(path + "-wal"));
  if (from == path + "-shm") CHECK(fs::exists(path + "-wal"));
}

TEST_CASE("closing a run with a replaced file fails, and its records are saved as a copy") {
  OpenRun open(3);
  const std::string second_copy = open.folder / "a.rescued-2.sqlite";
  write_file(open.copy, "other content");
  write_file(open.folder / "x", "precious");
  fs::rename(open.folder / "x", open.path);
  open.failure_of_close("complete", "its 3 records are in " + second_copy);
  check_whole(second_copy, 3);
  CHECK(contents(open.path) == "precious");
  CHECK_FALSE(fs::exists(open.path + "-wal"));
}

TEST_CASE("a run with a damaged file or with missing records is not closed as complete") {
  OpenRun open(20);
  const std::string &path = open.path, rescued = "; 19 of its 20 records are in " + open.copy;
  struct Attack {
    std::function<void()> act;
    bool noticed;  // at the next record
    std::string said;
  };
  const Attack attacks[] = {
      {[&] { open.checkpoint(), overwrite(path, 4096); }, true,
       "the readable part is in " + open.copy},
      {[&] { open.checkpoint(), fs::resize_file(path, 0); }, true, "nothing could be rescued: "},
      {[&] { fs::resize_file(path, 0); }, true, "the readable part is in " + open.copy},
      {[&] { damage(path, "without record ?1", {4}); }, false,
       "contains 19 records instead of 20" + rescued},
      {[&] { damage(path, "without record ?1", {4}), fs::remove(path); }, false,
       "was removed or renamed during the run" + rescued},
      {[&] { overwrite(path + "-wal", 0); }, false, "was damaged during the run: "}};
  const auto& [act, noticed, said] =
      attacks[GENERATE_COPY(range(std::size_t{0}, std::size(attacks)))];
  CAPTURE(said);
  act();
  if (noticed)
    check_error(ExitCode::disk, path + ": was damaged during the run: ", [&] { open.more(); });
  open.failure_of_close(noticed ? "stopped:disk" : "complete", said);
  if (noticed)
    CHECK(fs::exists(open.copy) != said.starts_with("nothing"));
  else
    CHECK(fs::exists(path + "-wal"));
}

TEST_CASE("a run continues if its file is touched, annotated and checkpointed") {
  OpenRun open(20);
  fs::last_write_time(open.path, fs::file_time_type::clock::now() + std::chrono::hours(1));
  open.more();
  put_note(open.path, "door", "me");
  open.checkpoint();
  open.more();
  CHECK(open.run->close("complete"));
  check_whole(open.path, 22);
}

TEST_CASE("a run with a truncated WAL ends at the next record and is saved as a copy") {
  const std::int64_t records = GENERATE(3, 70);
  OpenRun open(records);
  RunWriter& run = *open.run;
  fs::resize_file(open.path + "-wal", GENERATE(0, 100, 5000));
  const UtcTime utc = small_record(0).slot_utc;
  const std::function<void()> next[] = {
      [&] { open.more(); }, [&] { run.put_event(utc, Severity::info, "test", "shortened"); },
      [&] { run.put_late({}); }, [&] { run.new_label(utc); }};
  const std::size_t which = GENERATE(0u, 1u, 2u, 3u, 4u);
  if (which < 4) CHECK(error_of(next[which]).first == ExitCode::disk);
  CHECK(open.failure_of_close("complete") ==
        open.path + ": its -wal file was shortened during the run; its " + std::to_string(records) +
            " records are in " + open.copy);
  check_whole(open.copy, records);
}

TEST_CASE("a truncated WAL is detected even if a reader blocks the checkpoint") {
  OpenRun open(5);
  OtherProgram reader(open.path);
  reader.ask("BEGIN; SELECT count(*) FROM record");
  while (fs::file_size(open.path + "-wal") < 420 * 4096) open.more();
  fs::resize_file(open.path + "-wal", 5000);
  CHECK(check_error(ExitCode::disk, "", [&] { open.more(); }) ==
        open.path + ": its -wal file was shortened during the run");
}

TEST_CASE("a WAL checkpointed by another program is not reported as truncated") {
  OpenRun open(5);
  const std::string& path = open.path;
  SECTION("a checkpoint by another program in two steps is not reported") {
    sql(path, "PRAGMA wal_checkpoint");
    if (GENERATE(false, true)) open.more();
    open.checkpoint();
  }
  SECTION("a checkpoint by another program after one by the run is not reported") {
    while (fs::file_size(path) < 100'000 || fs::file_size(path + "-wal") == 0) open.more();
    open.checkpoint();
    CHECK(fs::file_size(path + "-wal") == 0);
  }
  open.more();
  CHECK(open.run->close("complete"));
  check_whole(path, open.records);
}

TEST_CASE("the memory use of the run writer does not grow with the length of the run") {
  const auto before = sqlite3_memory_used();
  const OpenRun open(0);
  for (auto next = a_small_run(500).made(); next.front().index < 20'000;) {
    open.run->append(next);
    for (FusedRecord& r : next) r.index += 500;
    CHECK(sqlite3_memory_used() - before < 2'600'000);
  }
  CHECK(fs::file_size(open.path) > 4'000'000);
}

TEST_CASE("a run continues after another program truncates its -shm file") {
  OpenRun open(6);
  const UtcTime utc = small_record(0).slot_utc;
  const std::function<void()> steps[] = {
      [&] { CHECK(open.run->new_label(utc) == std::nullopt); },
      [&] { open.run->put_event(utc, Severity::info, "test", "shortened"); }, [&] { open.more(); },
      [&] { CHECK(open.run->close("complete")); }};
  for (const auto& step : steps) {
    fs::resize_file(open.path + "-shm", 0);
    step();
  }
  check_whole(open.path, 7);
}

TEST_CASE("a run closes without waiting for readers, and the next program merges the WAL") {
  OpenRun open(5);
  const std::string& path = open.path;
  {
    OtherProgram reader(path);
    reader.ask("BEGIN; SELECT count(*) FROM record");
    open.more();
    const auto start = std::chrono::steady_clock::now();
    if (GENERATE(false, true))
      CHECK_FALSE(open.run->close("complete"));
    else
      check_error(ExitCode::failed, "the last records are not in this file but in " + path + "-wal",
                  [&] { open.run->close_as_one_file("complete"); });
    CHECK(std::chrono::steady_clock::now() - start < std::chrono::seconds(3));
    check_whole(path, 6);
    CHECK(fs::exists(path + "-wal"));
    // Closes the reader without a checkpoint, like a reader that is killed or has no write
    // permission.
    sqlite3_db_config(reader.db.get(), SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
  }
  recover(path);
  CHECK_FALSE(fs::exists(path + "-wal"));
  check_whole(path, 6);
}

TEST_CASE("a label that is waiting for access to the run file is refused if the run is closed") {
  const OpenRun open(1);
  OtherProgram closer(open.path);
  closer.ask("BEGIN IMMEDIATE; UPDATE run SET status = 'complete'");
  auto label = std::async(std::launch::async, [&] { put_label(open.path, "door", "me"); });
  // Gives put_label() enough time to find that the run is still open.
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  closer.ask("COMMIT");
  CHECK(has(error_of([&] { label.get(); }).second, "run is not being recorded"));
  CHECK(RunReader(open.path).events().empty());
}

TEST_CASE("a run requires a valid lock file and removes it at its end") {
  const Folder folder;
  const std::string path = folder / "a.sqlite", lock = path + "-lock";
  const auto begin = [&] { return a_small_run(1).open(path); };
  SECTION("a run is refused if another file occupies the path of its lock") {
    write_file(folder / "victim", "precious");
    fs::create_hard_link(folder / "victim", lock);
    check_error(ExitCode::failed, lock + ": is not an echofuse lock file", begin);
    CHECK_FALSE(fs::exists(path));
    CHECK(contents(folder / "victim") == "precious");
  }
  SECTION("a lock file left by a crash is reused") {
    write_file(lock, "");
    const auto run = begin();
    CHECK(WriterLock::someone_writes(path));
    CHECK_FALSE(WriterLock(path).held());
    run->close("complete");
    CHECK_FALSE(fs::exists(lock));
    CHECK_FALSE(WriterLock::someone_writes(path));
  }
  SECTION("the end of a run does not remove a lock file that replaced its own") {
    const auto run = begin();
    fs::remove(lock);
    const WriterLock other(path);
    CHECK(other.held());
    run->close("complete");
    CHECK(WriterLock::someone_writes(path));
  }
  SECTION("a reader's shared lock does not block the writer's lock") {
    begin()->close("complete");
    write_file(lock, "");
    const int reader = ::open(lock.c_str(), O_RDONLY);
    REQUIRE(flock(reader, LOCK_SH | LOCK_NB) == 0);
    CHECK(WriterLock(path).held());
    ::close(reader);
  }
}

TEST_CASE("a run file is refused on a file system that does not support shared memory") {
  const Folder folder;
  sqlite3_vfs* const before = sqlite3_vfs_find(nullptr);
  sqlite3_vfs_register(sqlite3_vfs_find("unix-dotfile"), 1);  // has no shared memory
  check_error(ExitCode::disk, "a.sqlite: this file system does not support a live run",
              [&] { a_small_run(0).open(folder / "a.sqlite"); });
  sqlite3_vfs_register(before, 1);
  CHECK_FALSE(fs::exists(folder / "a.sqlite"));
}

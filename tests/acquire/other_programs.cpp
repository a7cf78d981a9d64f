// SPDX-License-Identifier: MIT
// Tests other programs that access the files, the lock or the records of a run during recording.
#include <fcntl.h>
#include <sqlite3.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <future>
#include <map>

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

void overwrite(const std::string& path, std::size_t at, std::size_t size) {
  const int fd = ::open(path.c_str(), O_WRONLY);
  const std::string garbage(size, '\xde');
  REQUIRE(::pwrite(fd, garbage.data(), size, static_cast<off_t>(at)) == static_cast<ssize_t>(size));
  ::close(fd);
}

ino_t inode(const std::string& path) {
  struct stat file {};
  return ::stat(path.c_str(), &file) == 0 ? file.st_ino : 0;
}

void check_whole(const std::string& path, std::int64_t records, const std::string& status) {
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
  const std::string &path = open.path, other = open.folder / "x";
  write_file(other, "");
  struct Attack {
    const char* what;
    std::function<void()> act;
    std::string said;
  };
  const Attack attacks[] = {
      {"replaced", [&] { fs::rename(other, path); }, "was replaced by another file"},
      {"removed", [&] { fs::remove(path); }, "was removed or renamed"},
      {"renamed", [&] { fs::rename(path, other); }, "was removed or renamed"},
      {"WAL removed", [&] { fs::remove(path + "-wal"); }, "its -wal file was removed or renamed"},
      {"WAL replaced", [&] { fs::rename(other, path + "-wal"); },
       "its -wal file was replaced by another file"},
      {"index removed", [&] { fs::remove(path + "-shm"); }, "its -shm file was removed"},
  };
  for (const Attack& attack : attacks) DYNAMIC_SECTION(attack.what) {
      if (GENERATE(false, true)) open.checkpoint();
      open.more();
      attack.act();
      const std::string text =
          check_error(ExitCode::disk, path + ": " + attack.said, [&] { open.more(); });
      CHECK(open.failure_of_close("stopped:disk") == text + "; its 8 records are in " + open.copy);
      check_whole(open.copy, 8, "stopped:disk");
      CHECK_FALSE(fs::exists(open.copy + "-wal"));
      if (!fs::exists(path) || fs::file_size(path) == 0) CHECK_FALSE(fs::exists(path + "-wal"));
      if (attack.said.find("-shm") != std::string::npos) CHECK(fs::exists(path + "-wal"));
    }
}

TEST_CASE("closing a run with a replaced file fails, and its records are saved as a copy") {
  OpenRun open(3);
  const std::string second_copy = open.folder / "a.rescued-2.sqlite";
  write_file(open.copy, "other content");
  write_file(open.folder / "x", "precious");
  fs::rename(open.folder / "x", open.path);
  open.failure_of_close("complete", "its 3 records are in " + second_copy);
  check_whole(second_copy, 3, "complete");
  CHECK(contents(open.path) == "precious");
  CHECK_FALSE(fs::exists(open.path + "-wal"));
}

TEST_CASE("a run ends if its file is damaged and continues if the file is only touched") {
  OpenRun open(20);
  const std::string& path = open.path;
  const auto ends = [&](const std::string& said) {
    check_error(ExitCode::disk, path + ": was damaged during the run: ", [&] { open.more(); });
    open.failure_of_close("stopped:disk", said);
  };
  SECTION("an overwritten run file ends the run") {
    open.checkpoint();
    overwrite(path, 4096, fs::file_size(path) - 4096);
    ends("the readable part is in " + open.copy);
  }
  SECTION("a truncated run file ends the run") {
    open.checkpoint();
    fs::resize_file(path, 0);
    ends("nothing could be rescued: ");
    CHECK_FALSE(fs::exists(open.copy));
  }
  SECTION("a run file that is emptied while its records are in the WAL ends the run") {
    fs::resize_file(path, 0);
    ends("the readable part is in " + open.copy);
  }
  SECTION("a run file that is touched, annotated and checkpointed does not end the run") {
    fs::last_write_time(path, fs::file_time_type::clock::now() + std::chrono::hours(1));
    open.more();
    put_note(path, "door", "me");
    open.checkpoint();
    open.more();
    CHECK(open.run->close("complete"));
    check_whole(path, 22, "complete");
  }
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
  check_whole(open.copy, records, "complete");
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
  SECTION("a checkpoint by another program in two steps is not reported as a truncated WAL") {
    sql(path, "PRAGMA wal_checkpoint");
    if (GENERATE(false, true)) open.more();
    open.checkpoint();
  }
  SECTION(
      "a checkpoint by another program after one by the run is not reported as a truncated WAL") {
    while (fs::file_size(path) < 100'000 || fs::file_size(path + "-wal") == 0) open.more();
    open.checkpoint();
    CHECK(fs::file_size(path + "-wal") == 0);
  }
  open.more();
  CHECK(open.run->close("complete"));
  check_whole(path, open.records, "complete");
}

TEST_CASE("the memory use of the run writer does not grow with the length of the run") {
  const auto before = sqlite3_memory_used();
  OpenRun open(0);
  std::vector<FusedRecord> batch;
  for (std::int64_t i = 0; i < 20'000; ++i) {
    batch.push_back(small_record(i));
    if (batch.size() < 500) continue;
    open.run->append(batch);
    batch.clear();
    CHECK(sqlite3_memory_used() - before < 2'600'000);
  }
  CHECK(fs::file_size(open.path) > 4'000'000);
}

TEST_CASE("a run with missing records is not given the status complete") {
  OpenRun open(6);
  const std::string& path = open.path;
  std::string said;
  SECTION("a run with deleted rows is not given the status complete") {
    damage(path, "without record ?1", {4});
    said = "contains 5 records instead of 6; 5 of its 6 records are in " + open.copy;
  }
  SECTION("a run with deleted rows and a deleted run file is not given the status complete") {
    damage(path, "without record ?1", {4});
    fs::remove(path);
    said = "was removed or renamed during the run; 5 of its 6 records are in " + open.copy;
  }
  SECTION("a run with an overwritten WAL is not given the status complete") {
    overwrite(path + "-wal", 0, fs::file_size(path + "-wal"));
    said = "was damaged during the run: ";
  }
  open.failure_of_close("complete", path + ": " + said);
  CHECK(fs::exists(path + "-wal"));
}

TEST_CASE("a run continues after another program truncates its -shm file") {
  OpenRun open(6);
  const auto shorten = [&] { fs::resize_file(open.path + "-shm", 0); };
  const UtcTime utc = small_record(0).slot_utc;
  shorten();
  CHECK(open.run->new_label(utc) == std::nullopt);
  shorten();
  open.run->put_event(utc, Severity::info, "test", "shortened");
  shorten();
  open.more();
  shorten();
  CHECK(open.run->close("complete"));
  check_whole(open.path, 7, "complete");
}

TEST_CASE(
    "a run closes without waiting for readers, and the next program to open it merges the WAL") {
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
    check_whole(path, 6, "complete");
    CHECK(fs::exists(path + "-wal"));
    // Closes the reader without a checkpoint, like a reader that is killed or has no write
    // permission.
    sqlite3_db_config(reader.db.get(), SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
  }
  recover(path);
  CHECK_FALSE(fs::exists(path + "-wal"));
  check_whole(path, 6, "complete");
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
    CHECK(fs::file_size(folder / "victim") == 8);
    CHECK_FALSE(WriterLock::someone_writes(path));
  }
  SECTION("a lock file left by a crash is reused") {
    write_file(lock, std::string(128 << 10, '\0'));
    const ino_t before = inode(lock);
    const auto run = begin();
    CHECK(WriterLock::someone_writes(path));
    CHECK_FALSE(WriterLock(path).held());
    CHECK(fs::file_size(lock) == 128 << 10);
    CHECK(inode(lock) == before);
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

namespace {

// Opens a file through SQLite's default VFS, but disables support for shared memory.
int open_without_memory(sqlite3_vfs* self, const char* name, sqlite3_file* file, int flags,
                        int* out) {
  auto* whole = static_cast<sqlite3_vfs*>(self->pAppData);
  const int code = whole->xOpen(whole, name, file, flags, out);
  if (file->pMethods) {
    // SQLite uses separate I/O methods for the database and for its journal.
    static std::map<const sqlite3_io_methods*, sqlite3_io_methods> of_kind;
    sqlite3_io_methods& plain = of_kind[file->pMethods] = *file->pMethods;
    plain.iVersion = 1;
    file->pMethods = &plain;
  }
  return code;
}

}  // namespace

TEST_CASE("a run file is refused on a file system that does not support shared memory") {
  const Folder folder;
  sqlite3_vfs* const whole = sqlite3_vfs_find(nullptr);
  sqlite3_vfs network = *whole;
  network.zName = "network";
  network.pAppData = whole;
  network.xOpen = open_without_memory;
  sqlite3_vfs_register(&network, 1);
  check_error(ExitCode::disk, "a.sqlite: this file system does not support a live run",
              [&] { a_small_run(0).open(folder / "a.sqlite"); });
  sqlite3_vfs_register(whole, 1);
  sqlite3_vfs_unregister(&network);
  CHECK_FALSE(fs::exists(folder / "a.sqlite"));
}

// SPDX-License-Identifier: MIT
// Tests other programs that access the files, the lock or the records of a run during recording.
#include <fcntl.h>
#include <sqlite3.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <future>
#include <map>

#include "acquire/record/annotate.hpp"
#include "acquire/record/recover.hpp"
#include "acquire/record/writer_lock.hpp"
#include "testing.hpp"

using namespace echofuse::record;

namespace {

using Database = std::unique_ptr<sqlite3, int (*)(sqlite3*)>;

Database open(const std::string& path) {
  sqlite3* db = nullptr;
  REQUIRE(sqlite3_open(path.c_str(), &db) == SQLITE_OK);
  return {db, sqlite3_close};
}

void sql(const Database& db, const char* statement) {
  REQUIRE(sqlite3_exec(db.get(), statement, nullptr, nullptr, nullptr) == SQLITE_OK);
}

std::unique_ptr<RunWriter> begin(const std::string& path, std::int64_t records) {
  return a_small_run(records).open(path);
}

// Copies the committed data from the WAL to the database, as another program may do at any time.
void checkpoint(const std::string& path) { sql(open(path), "PRAGMA wal_checkpoint(TRUNCATE)"); }

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
  const Folder folder;
  const std::string path = folder / "a.sqlite", copy = folder / "a.rescued.sqlite";
  write_file(folder / "x", "");
  struct Attack {
    const char* what;
    std::function<void()> act;
    std::string said;
  };
  const Attack attacks[] = {
      {"replaced", [&] { fs::rename(folder / "x", path); }, "was replaced by another file"},
      {"removed", [&] { fs::remove(path); }, "was removed or renamed"},
      {"renamed", [&] { fs::rename(path, folder / "b"); }, "was removed or renamed"},
      {"WAL removed", [&] { fs::remove(path + "-wal"); }, "its -wal file was removed or renamed"},
      {"WAL replaced", [&] { fs::rename(folder / "x", path + "-wal"); },
       "its -wal file was replaced by another file"},
      {"index removed", [&] { fs::remove(path + "-shm"); }, "its -shm file was removed"},
  };
  for (const Attack& attack : attacks) DYNAMIC_SECTION(attack.what) {
      const auto run = begin(path, 7);
      if (GENERATE(false, true)) checkpoint(path);
      run->append(small_record(7));
      attack.act();
      const auto [code, text] = error_of([&] { run->append(small_record(8)); });
      CHECK(code == ExitCode::disk);
      CHECK(has(text, path + ": " + attack.said));
      const auto [end, said] = error_of([&] { run->close("stopped:disk"); });
      CHECK(end == ExitCode::disk);
      CHECK(said == text + "; its 8 records are in " + copy);
      check_whole(copy, 8, "stopped:disk");
      CHECK_FALSE(fs::exists(copy + "-wal"));
      if (!fs::exists(path) || fs::file_size(path) == 0) CHECK_FALSE(fs::exists(path + "-wal"));
      if (attack.said.find("-shm") != std::string::npos) CHECK(fs::exists(path + "-wal"));
    }
}

TEST_CASE("closing a run with a replaced file fails, and its records are saved as a copy") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  write_file(folder / "a.rescued.sqlite", "other content");
  const auto run = begin(path, 3);
  write_file(folder / "x", "precious");
  fs::rename(folder / "x", path);
  check_error(ExitCode::disk, "its 3 records are in " + folder / "a.rescued-2.sqlite",
              [&] { run->close("complete"); });
  check_whole(folder / "a.rescued-2.sqlite", 3, "complete");
  CHECK(fs::file_size(path) == 8);
  CHECK_FALSE(fs::exists(path + "-wal"));
}

TEST_CASE("a run ends if its file is damaged and continues if the file is only touched") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto run = begin(path, 20);
  const auto ends = [&](const std::string& said) {
    check_error(ExitCode::disk,
                path + ": was damaged during the run: ", [&] { run->append(small_record(20)); });
    const auto end = error_of([&] { run->close("stopped:disk"); });
    CHECK(end.first == ExitCode::disk);
    CHECK(has(end.second, said));
  };
  SECTION("an overwritten run file ends the run") {
    checkpoint(path);
    overwrite(path, 4096, fs::file_size(path) - 4096);
    ends("the readable part is in " + folder / "a.rescued.sqlite");
  }
  SECTION("a truncated run file ends the run") {
    checkpoint(path);
    fs::resize_file(path, 0);
    ends("nothing could be rescued: ");
    CHECK_FALSE(fs::exists(folder / "a.rescued.sqlite"));
  }
  SECTION("a run file that is emptied while its records are in the WAL ends the run") {
    fs::resize_file(path, 0);
    ends("the readable part is in " + folder / "a.rescued.sqlite");
  }
  SECTION("a run file that is touched, annotated and checkpointed does not end the run") {
    fs::last_write_time(path, fs::file_time_type::clock::now() + std::chrono::hours(1));
    run->append(small_record(20));
    put_note(path, "door", "me");
    checkpoint(path);
    run->append(small_record(21));
    CHECK(run->close("complete"));
    check_whole(path, 22, "complete");
  }
}

TEST_CASE("a run with a truncated WAL ends at the next record and is saved as a copy") {
  const Folder folder;
  const std::string path = folder / "a.sqlite", copy = folder / "a.rescued.sqlite";
  const std::int64_t records = GENERATE(3, 70);
  const auto run = begin(path, records);
  fs::resize_file(path + "-wal", GENERATE(0, 100, 5000));
  const UtcTime utc = small_record(0).slot_utc;
  const std::function<void()> next[] = {
      [&] { run->append(small_record(records)); },
      [&] { run->put_event(utc, Severity::info, "test", "shortened"); }, [&] { run->put_late({}); },
      [&] { run->new_label(utc); }};
  const std::size_t which = GENERATE(0u, 1u, 2u, 3u, 4u);
  if (which < 4) CHECK(error_of(next[which]).first == ExitCode::disk);
  const auto [code, text] = error_of([&] { run->close("complete"); });
  CHECK(code == ExitCode::disk);
  CHECK(text == path + ": its -wal file was shortened during the run; its " +
                    std::to_string(records) + " records are in " + copy);
  check_whole(copy, records, "complete");
}

TEST_CASE("a truncated WAL is detected even if a reader blocks the checkpoint") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto run = begin(path, 5);
  const Database reader = open(path);
  sql(reader, "BEGIN; SELECT count(*) FROM record");
  std::int64_t records = 5;
  while (fs::file_size(path + "-wal") < 420 * 4096) run->append(small_record(records++));
  fs::resize_file(path + "-wal", 5000);
  const auto [code, text] = error_of([&] { run->append(small_record(records)); });
  CHECK(code == ExitCode::disk);
  CHECK(text == path + ": its -wal file was shortened during the run");
}

TEST_CASE("a WAL checkpointed by another program is not reported as truncated") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto run = begin(path, 5);
  std::int64_t records = 5;
  const auto more = [&] { run->append(small_record(records++)); };
  SECTION("a checkpoint by another program in two steps is not reported as a truncated WAL") {
    sql(open(path), "PRAGMA wal_checkpoint");
    if (GENERATE(false, true)) more();
    checkpoint(path);
  }
  SECTION(
      "a checkpoint by another program after one by the run is not reported as a truncated WAL") {
    while (fs::file_size(path) < 100'000 || fs::file_size(path + "-wal") == 0) more();
    checkpoint(path);
    CHECK(fs::file_size(path + "-wal") == 0);
  }
  more();
  CHECK(run->close("complete"));
  check_whole(path, records, "complete");
}

TEST_CASE("the memory use of the run writer does not grow with the length of the run") {
  const Folder folder;
  const auto before = sqlite3_memory_used();
  const auto run = begin(folder / "a.sqlite", 0);
  std::vector<FusedRecord> batch;
  for (std::int64_t i = 0; i < 20'000; ++i) {
    batch.push_back(small_record(i));
    if (batch.size() < 500) continue;
    run->append(batch);
    batch.clear();
    CHECK(sqlite3_memory_used() - before < 2'600'000);
  }
  CHECK(fs::file_size(folder / "a.sqlite") > 4'000'000);
}

TEST_CASE("a run with missing records is not given the status complete") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto run = begin(path, 6);
  std::string said;
  SECTION("a run with deleted rows is not given the status complete") {
    damage(path, "without record ?1", {4});
    said =
        "contains 5 records instead of 6; 5 of its 6 records are in " + folder / "a.rescued.sqlite";
  }
  SECTION("a run with deleted rows and a deleted run file is not given the status complete") {
    damage(path, "without record ?1", {4});
    fs::remove(path);
    said = "was removed or renamed during the run; 5 of its 6 records are in " +
           folder / "a.rescued.sqlite";
  }
  SECTION("a run with an overwritten WAL is not given the status complete") {
    overwrite(path + "-wal", 0, fs::file_size(path + "-wal"));
    said = "was damaged during the run: ";
  }
  check_error(ExitCode::disk, path + ": " + said, [&] { run->close("complete"); });
  CHECK(fs::exists(path + "-wal"));
}

TEST_CASE("a run continues after another program truncates its -shm file") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto run = begin(path, 6);
  const auto shorten = [&] { fs::resize_file(path + "-shm", 0); };
  const UtcTime utc = small_record(0).slot_utc;
  shorten();
  CHECK(run->new_label(utc) == std::nullopt);
  shorten();
  run->put_event(utc, Severity::info, "test", "shortened");
  shorten();
  run->append(small_record(6));
  shorten();
  CHECK(run->close("complete"));
  check_whole(path, 7, "complete");
}

TEST_CASE(
    "a run closes without waiting for readers, and the next program to open it merges the WAL") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto run = begin(path, 5);
  {
    const Database reader = open(path);
    sql(reader, "BEGIN; SELECT count(*) FROM record");
    run->append(small_record(5));
    const auto start = std::chrono::steady_clock::now();
    if (GENERATE(false, true)) {
      CHECK_FALSE(run->close("complete"));
    } else {
      check_error(ExitCode::failed, "the last records are not in this file but in " + path + "-wal",
                  [&] { run->close_as_one_file("complete"); });
    }
    CHECK(std::chrono::steady_clock::now() - start < std::chrono::seconds(3));
    check_whole(path, 6, "complete");
    CHECK(fs::exists(path + "-wal"));
    // Closes the reader without a checkpoint, like a reader that is killed or has no write
    // permission.
    sqlite3_db_config(reader.get(), SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
  }
  recover(path);
  CHECK_FALSE(fs::exists(path + "-wal"));
  check_whole(path, 6, "complete");
}

TEST_CASE("a label that is waiting for access to the run file is refused if the run is closed") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto run = begin(path, 1);
  const Database closer = open(path);
  sql(closer, "BEGIN IMMEDIATE; UPDATE run SET status = 'complete'");
  auto label = std::async(std::launch::async, [&] { put_label(path, "door", "me"); });
  // Gives put_label() enough time to find that the run is still open.
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  sql(closer, "COMMIT");
  CHECK(has(error_of([&] { label.get(); }).second, "run is not being recorded"));
  CHECK(RunReader(path).events().empty());
}

TEST_CASE("a run requires a valid lock file and removes it at its end") {
  const Folder folder;
  const std::string path = folder / "a.sqlite", lock = path + "-lock";
  SECTION("a run is refused if another file occupies the path of its lock") {
    write_file(folder / "victim", "precious");
    fs::create_hard_link(folder / "victim", lock);
    check_error(ExitCode::failed, lock + ": is not an echofuse lock file", [&] { begin(path, 0); });
    CHECK_FALSE(fs::exists(path));
    CHECK(fs::file_size(folder / "victim") == 8);
    CHECK_FALSE(WriterLock::someone_writes(path));
  }
  SECTION("a lock file left by a crash is reused") {
    write_file(lock, std::string(128 << 10, '\0'));
    const ino_t before = inode(lock);
    auto run = begin(path, 1);
    CHECK(WriterLock::someone_writes(path));
    CHECK_FALSE(WriterLock(path).held());
    CHECK(fs::file_size(lock) == 128 << 10);
    CHECK(inode(lock) == before);
    run->close("complete");
    CHECK_FALSE(fs::exists(lock));
    CHECK_FALSE(WriterLock::someone_writes(path));
  }
  SECTION("the end of a run does not remove a lock file that replaced its own") {
    auto run = begin(path, 1);
    fs::remove(lock);
    const WriterLock other(path);
    CHECK(other.held());
    run->close("complete");
    CHECK(WriterLock::someone_writes(path));
  }
  SECTION("a reader's shared lock does not block the writer's lock") {
    begin(path, 1)->close("complete");
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
  const auto [code, text] = error_of([&] { begin(folder / "a.sqlite", 0); });
  sqlite3_vfs_register(whole, 1);
  sqlite3_vfs_unregister(&network);
  CHECK(code == ExitCode::disk);
  CHECK(has(text, "a.sqlite: this file system does not support a live run"));
  CHECK_FALSE(fs::exists(folder / "a.sqlite"));
}

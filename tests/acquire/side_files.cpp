// SPDX-License-Identifier: MIT
// Files beside a run file by its name: a -wal of its own, of another run, or none.
#include <unistd.h>

#include "acquire/commands/commands.hpp"
#include "testing.hpp"

using namespace echofuse;
using namespace echofuse::record;
using namespace testing;

TEST_CASE("a -wal of another run beside a closed one is named, and nothing is written") {
  const Folder folder;
  const std::string path = folder / "a.sqlite", wal = path + "-wal";
  RunWriter other(folder / "b.sqlite", {});
  for (const auto& axis : small_axes()) other.put_axis(axis);
  for (int i = 0; i < 14; ++i) other.append(small_record(i));
  write_run(path, 3);
  const auto contents = [&] { return testing::contents(path); };
  const std::string before = contents();
  fs::copy_file(folder / "b.sqlite-wal", wal);
  const auto refuses = [&](const auto& body) {
    const auto [code, text] = error_of(body);
    CHECK(code == ExitCode::failed);
    CHECK(has(text, path + ": is closed, and " + wal + " beside it is of another run"));
  };
  refuses([&] { RunReader run(path); });
  refuses([&] { RunReader run(path, ""); });
  refuses([&] { put_note(path, "a note", "me"); });
  refuses([&] { put_label(path, "a", "me"); });
  recover(path);
  CHECK(contents() == before);
  CHECK_FALSE(fs::exists(path + "-shm"));
  fs::remove(wal);
  CHECK(RunReader(path).count() == 3);
  CHECK(RunReader(folder / "b.sqlite").count() == 14);
}

TEST_CASE("a copy without the -wal of its run says so, and stays as it is") {
  const Folder folder;
  const std::string path = folder / "copy.sqlite";
  {
    RunWriter run(folder / "a.sqlite", {});
    for (const auto& axis : small_axes()) run.put_axis(axis);
    for (int i = 0; i < 3; ++i) run.append(small_record(i));
    fs::copy_file(folder / "a.sqlite", path);
    fs::copy_file(folder / "a.sqlite-wal", folder / "kept");
  }
  for (int time = 0; time < 2; ++time) {
    recover(path);
    CHECK(RunReader(path).info().status == crashed_without_wal);
    for (const char* beside : {"-wal", "-shm"}) CHECK_FALSE(fs::exists(path + beside));
  }
  CHECK(has(acquire::describe_run(path, false),
            "its last records are in " + path + "-wal, which is not here"));
  fs::copy_file(folder / "kept", path + "-wal");
  CHECK(RunReader(path).info().status == "crashed");
  CHECK(RunReader(path).count() == 3);
}

// As a kill leaves it between the two steps of SQLite's journal_mode=DELETE.
TEST_CASE("a run whose header alone was not closed is read, also where nothing may be written") {
  const Folder folder;
  fs::create_directory(folder / "in");
  const std::string path = folder / "in/a.sqlite";
  write_run(path, 3);
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

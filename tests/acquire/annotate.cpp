// SPDX-License-Identifier: MIT
// Tests notes that are added to closed runs.
#include "acquire/record/annotate.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <future>
#include <set>

#include "../fixtures/full_disk.hpp"
#include "acquire/record/writer_lock.hpp"
#include "testing.hpp"

using namespace echofuse::record;

namespace {

struct stat file_at(const std::string& path) {
  struct stat out {};
  REQUIRE(::stat(path.c_str(), &out) == 0);
  return out;
}

std::set<std::string> names_in(const std::string& folder) {
  std::set<std::string> out;
  for (const auto& entry : fs::directory_iterator(folder)) out.insert(entry.path().filename());
  return out;
}

}  // namespace

TEST_CASE("annotating a closed run replaces its file, and keeps its owner, mode and links") {
  const Folder folder;
  fs::create_directory(folder / "real");
  const std::string path = folder / "real/a.sqlite", link = folder / "link.sqlite";
  a_small_run(3).write(path);
  fs::remove(path + "-lock");
  REQUIRE(::chmod(path.c_str(), 0664) == 0);
  constexpr uid_t nobody = 65534;
  if (::geteuid() == 0) REQUIRE(::chown(path.c_str(), nobody, nobody) == 0);
  fs::create_symlink("real/a.sqlite", link);
  const struct stat before = file_at(path);
  const RunReader reader(path);  // put_note() must work while a reader has the run open
  put_note(link, "door", "me");
  const struct stat now = file_at(path);
  CHECK(now.st_ino != before.st_ino);
  CHECK(std::vector{now.st_mode, now.st_uid, now.st_gid} ==
        std::vector{before.st_mode, before.st_uid, before.st_gid});
  CHECK(fs::is_symlink(link));
  CHECK(names_in(folder / "real") == std::set<std::string>{"a.sqlite"});
  CHECK(reader.events().empty());
  CHECK(RunReader(path).events().at(0).text == "door");
  CHECK(is_closed(path));
}

TEST_CASE("the annotate command waits while another program holds the lock of a closed run") {
  const Folder folder;
  const std::string path = a_small_run(3).write(folder / "a.sqlite");
  std::optional<WriterLock> lock(path);
  REQUIRE(lock->held());
  auto note = std::async(std::launch::async, [&] { put_note(path, "door", "me"); });
  ::usleep(200'000);
  CHECK(RunReader(path).events().empty());
  lock.reset();
  note.get();
  CHECK(RunReader(path).events().size() == 1);
}

TEST_CASE("the annotate command leaves the run file unchanged if the disk is full") {
  const Folder folder;
  const std::string path = a_small_run(3).write(folder / "a.sqlite");
  const std::string before = contents(path);
  const auto names = names_in(folder.path);
  {
    const test::FullDisk disk(before.size() / 2);
    CHECK(error_of([&] { put_note(path, "door", "me"); }).first == ExitCode::disk);
  }
  CHECK(contents(path) == before);
  CHECK(names_in(folder.path) == names);
}

TEST_CASE("killing the annotate command leaves the old or the new file, but no SQLite side files") {
  const Folder folder;
  const std::string path = a_small_run(200).write(folder / "a.sqlite");
  std::minstd_rand random(1);
  std::size_t notes = 0;
  for (int round = 0; round < 60 || (notes == 0 && round < 600); ++round) {
    const pid_t child = fork();
    REQUIRE(child >= 0);
    if (child == 0)
      for (int n = 0;; ++n) put_note(path, std::to_string(n), "me");
    // The child process is killed after at most 50 ms. From round 60 on, the limit grows, because
    // the child may start late on a busy machine.
    const auto longest_us = 50'000 * (1 + static_cast<unsigned>(round) / 60);
    ::usleep(static_cast<useconds_t>(random() % longest_us));
    ::kill(child, SIGKILL);
    REQUIRE(waitpid(child, nullptr, 0) == child);
    CHECK(side_files(path).empty());
    for (const std::string& name : names_in(folder.path))
      CHECK(std::set<std::string>{"a.sqlite", "a.sqlite-lock", "a.sqlite-new"}.contains(name));
    const RunReader run(path);
    REQUIRE(is_closed(path));
    CHECK(run.check().empty());
    CHECK(run.count() == 200);
    CHECK(run.events().size() >= notes);
    notes = run.events().size();
  }
  CHECK(notes > 0);
  put_note(path, "last", "me");
  CHECK_FALSE(fs::exists(path + "-new"));
}

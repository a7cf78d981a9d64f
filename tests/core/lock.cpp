// SPDX-License-Identifier: MIT
#include "drivers/util/lock.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <atomic>

#include "../fixtures/error.hpp"
#include "../fixtures/folder.hpp"

using test::contents;
using test::Folder;
namespace fs = std::filesystem;

TEST_CASE("a lock excludes other holders and names its holder") {
  const Folder folder;
  const std::string path = folder / "x.lock";
  CHECK_FALSE(Lock::holder(path));
  {
    const Lock held(path, 0644);
    CHECK(held.held());
    CHECK(Lock::holder(path) == "");
    held.write("me\n");
    const std::string before = contents(path);
    const Lock refused(path, 0644);
    CHECK_FALSE(refused.held());
    refused.remove(), refused.empty();  // neither call changes the file of the lock's holder
    CHECK(contents(path) == before);
    CHECK(Lock::holder(path) == "me\n");
    CHECK(Lock(folder / "y.lock", 0644).held());
  }
  CHECK_FALSE(Lock::holder(path));
  CHECK(contents(path).empty());
  const Lock former(path, 0644);
  CHECK(former.held());
  former.remove();
  const Lock next(path, 0644);  // creates the file again
  CHECK(next.held());
  CHECK_FALSE(Lock(path, 0644).held());
}

TEST_CASE(
    "only one of many concurrent callers holds a lock, even if holders remove the lock file") {
  const Folder folder;
  const std::string path = folder / "x.lock";
  const bool removes = GENERATE(false, true);
  CAPTURE(removes);
  std::atomic<int> holders{0}, most{0}, taken{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (int i = 0; i < 300; ++i) {
        const Lock lock(path, 0600);
        if (!lock.held()) continue;
        most = std::max(most.load(), ++holders);
        ++taken;
        lock.write("me");
        std::this_thread::yield();
        --holders;
        if (removes) lock.remove();
      }
    });
  for (auto& thread : threads) thread.join();
  CHECK(most == 1);
  CHECK(taken > 0);
  CHECK(fs::exists(path) == !removes);
}

TEST_CASE("a lock file has the requested mode, whatever the umask") {
  const Folder folder;
  const mode_t mode = GENERATE(0666, 0644, 0600), before = ::umask(0077);
  const Lock lock(folder / "x.lock", mode);
  ::umask(before);
  CHECK((fs::status(folder / "x.lock").permissions() & fs::perms::mask) ==
        static_cast<fs::perms>(mode));
}

TEST_CASE("a lock is refused if another file occupies its path, and that file is not changed") {
  const Folder folder;
  const std::string precious = folder / "precious", lock = folder / "x.lock";
  const std::string kind = GENERATE("symbolic link", "dangling link", "hard link",
                                    "empty hard link", "file", "FIFO", "folder");
  CAPTURE(kind);
  const std::string stays = kind == "empty hard link" ? "" : "precious";
  std::ofstream(precious) << stays;
  if (kind == "symbolic link") fs::create_symlink(precious, lock);
  if (kind == "dangling link") fs::create_symlink(folder / "new", lock);
  if (kind.ends_with("hard link")) fs::create_hard_link(precious, lock);
  if (kind == "file") fs::copy_file(precious, lock);
  if (kind == "FIFO") REQUIRE(::mkfifo(lock.c_str(), 0666) == 0);
  if (kind == "folder") fs::create_directory(lock);
  const auto is = fs::symlink_status(lock).type();
  CHECK_THROWS_WITH(Lock(lock, 0666), Catch::Contains("x.lock: is not an echofuse lock file"));
  CHECK_FALSE(Lock::holder(lock));
  CHECK(fs::symlink_status(lock).type() == is);
  CHECK(contents(precious) == stays);
  CHECK_FALSE(fs::exists(folder / "new"));
  if (is == fs::file_type::regular) CHECK(contents(lock) == stays);
  // A lock file that cannot be created is a disk error.
  CHECK(test::error_of([&] { Lock(folder / "none/x.lock", 0600); }).first == ExitCode::disk);
}

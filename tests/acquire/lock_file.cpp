// SPDX-License-Identifier: MIT
// Who uses a device, as other programs see it.
#include "acquire/devices/lock_file.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>
#include <vector>

#include "acquire/devices/device_locks.hpp"
#include "drivers/program/exit_code.hpp"

using namespace echofuse;
using namespace echofuse::acquire;
using Catch::Contains;
namespace fs = std::filesystem;

namespace {

struct Folder {
  Folder() {
    char name[] = "/tmp/echofuse-locks-XXXXXX";
    path = ::mkdtemp(name);
  }
  ~Folder() { fs::remove_all(path); }
  std::string operator/(const std::string& name) const { return path + "/" + name; }
  std::string path;
};

const Holder first{"echofuse-acquire run, pid 1, run /data/a b\n.sqlite", "/data/a b\n.sqlite"};
const Holder second{"echofuse-acquire devices, pid 2", ""};

std::string text_of(const std::string& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

TEST_CASE("a lock says who holds it, and is free again when he is gone") {
  const Folder folder;
  {
    const LockFile held(folder.path, "x.lock", first);
    CHECK_FALSE(held.other());
    const LockFile refused(folder.path, "x.lock", second);
    REQUIRE(refused.other());
    CHECK(refused.other()->who == "echofuse-acquire run, pid 1, run /data/a b\\n.sqlite");
    CHECK(refused.other()->run == first.run);
    CHECK_FALSE(LockFile(folder.path, "y.lock", second).other());
  }
  const LockFile again(folder.path, "x.lock", second);
  CHECK_FALSE(again.other());
  const LockFile third(folder.path, "x.lock", first);
  REQUIRE(third.other());
  CHECK(third.other()->who == second.who);
  CHECK(third.other()->run.empty());
}

TEST_CASE("the refused one does not disturb what stands in the lock") {
  const Folder folder;
  const LockFile held(folder.path, "x.lock", first);
  const std::string before = text_of(folder / "x.lock");
  for (int i = 0; i < 3; ++i) CHECK(LockFile(folder.path, "x.lock", second).other());
  CHECK(text_of(folder / "x.lock") == before);
}

TEST_CASE("of many who want a lock at once one has it, however often it is given back") {
  const Folder folder;
  std::atomic<int> holders{0}, most{0}, taken{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (int i = 0; i < 200; ++i) {
        const LockFile lock(folder.path, "x.lock", first);
        if (lock.other()) continue;
        most = std::max(most.load(), ++holders);
        ++taken;
        std::this_thread::yield();
        --holders;
      }
    });
  for (auto& thread : threads) thread.join();
  CHECK(most == 1);
  CHECK(taken > 0);
  CHECK(text_of(folder / "x.lock").empty());
}

TEST_CASE("every user may take a lock") {
  const Folder folder;
  const mode_t before = ::umask(0077);
  const LockFile lock(folder.path, "x.lock", first);
  ::umask(before);
  CHECK((fs::status(folder / "x.lock").permissions() & fs::perms::mask) ==
        static_cast<fs::perms>(0666));
}

TEST_CASE("a link or another's file in the lock's place is refused and stays as it is") {
  const Folder folder;
  const std::string precious = folder / "precious", lock = folder / "x.lock";
  std::ofstream(precious) << "precious";
  const auto refused = [&](const char* why) {
    CHECK_THROWS_WITH(LockFile(folder.path, "x.lock", first),
                      Contains("x.lock: ") && Contains(why));
    CHECK(text_of(precious) == "precious");
  };
  SECTION("symbolic link") {
    fs::create_symlink(precious, lock);
    refused("is a symbolic link");
  }
  SECTION("symbolic link to nothing") {
    fs::create_symlink(folder / "new", lock);
    refused("is a symbolic link");
    CHECK_FALSE(fs::exists(folder / "new"));
  }
  SECTION("hard link") {
    fs::create_hard_link(precious, lock);
    refused("is not a file that");
  }
  SECTION("hard link to what begins like a lock") {
    std::ofstream(precious).flush();
    fs::create_hard_link(precious, lock);
    CHECK_THROWS_WITH(LockFile(folder.path, "x.lock", first), Contains("is not a file that"));
    CHECK(fs::exists(lock));
    CHECK(text_of(precious).empty());
  }
  SECTION("a file of other content") {
    fs::copy_file(precious, lock);
    refused("is not a file that");
    CHECK(text_of(lock) == "precious");
  }
  SECTION("fifo") {
    REQUIRE(::mkfifo(lock.c_str(), 0666) == 0);
    refused("is not a file that");
  }
}

TEST_CASE("a device is known by its address") {
  const Folder folder;
  std::ofstream(folder / "record.oni") << "";
  CHECK_THAT(lock_name("serial:/dev/ttyUSB0"), Catch::StartsWith("echofuse-serial-"));
  CHECK(lock_name("serial:/dev/../dev/ttyUSB0") == lock_name("serial:/dev/ttyUSB0"));
  CHECK(lock_name("serial:/dev/ttyUSB1") != lock_name("serial:/dev/ttyUSB0"));
  CHECK(lock_name("bridge:tcp://h:1") != lock_name("bridge:tcp://h:2"));
  CHECK(lock_name("bridge:tcp://localhost:1") == lock_name("bridge:tcp://127.0.0.1:1"));
  CHECK(lock_name("openni:" + (folder / "record.oni")).empty());
}

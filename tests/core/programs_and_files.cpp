// SPDX-License-Identifier: MIT
#include <fcntl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>

#include "../fixtures/folder.hpp"
#include "../fixtures/full_disk.hpp"
#include "drivers/core/bytes.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/new_file.hpp"
#include "drivers/util/program.hpp"
#include "drivers/util/regular_file.hpp"

using test::contents;
using test::Folder;
namespace fs = std::filesystem;

TEST_CASE("a file is replaced completely or not at all") {
  const Folder folder;
  const std::string path = folder.path / "a.txt";
  write_atomically(path, "old");
  CHECK(contents(path) == "old");
  {
    const test::FullDisk disk(2);
    CHECK_THROWS_WITH(write_atomically(path, "half of it"),
                      path + ": cannot be written: File too large");
  }
  CHECK(contents(path) == "old");
  CHECK(std::distance(fs::directory_iterator(folder.path), {}) == 1);
  write_atomically(path, "new");
  CHECK(contents(path) == "new");
  CHECK_THROWS_AS(write_atomically(folder.path / "none" / "a.txt", "new"), Error);
  for (const auto& [start, kind] : {std::pair{std::string("SQLite format 3"), "run"},
                                    {std::string("\1\1\0\0\0\0\0\0{", 9), "model"}}) {
    std::ofstream(path, std::ios::binary) << start;
    CHECK_THROWS_WITH(write_atomically(path, "new"),
                      path + ": is a " + kind + "; choose another name for the output");
    CHECK(contents(path) == start);
  }
}

TEST_CASE("the -wal file of another database is renamed, not deleted") {
  const Folder folder;
  const std::string path = folder.path / "a.sqlite";
  const std::string frames(5000, 'f');
  for (const char* name : {"a.sqlite-wal", "a.sqlite-journal", "a.sqlite-wal.kept"})
    std::ofstream(folder.path / name) << (std::string(name).ends_with("kept") ? "older" : frames);
  {
    NewFile file(path, path + "-new");
    file.create();
    REQUIRE(file.publish_new());
  }
  CHECK(contents(path + "-wal.kept") == "older");
  CHECK(contents(path + "-wal.kept-2") == frames);
  CHECK(contents(path + "-journal.kept") == frames);
  for (const char* suffix : {"-wal", "-journal"}) CHECK_FALSE(fs::exists(path + suffix));
}

TEST_CASE("writing a file replaces a symbolic link at its path and does not follow the link") {
  const Folder folder;
  const std::string path = folder.path / "a.txt", victim = folder.path / "victim";
  std::ofstream(victim) << "precious";
  fs::create_symlink(victim, path);
  fs::create_symlink(victim, path + ".part");
  write_atomically(path, "new");
  CHECK(contents(victim) == "precious");
  CHECK(contents(path) == "new");
  CHECK_FALSE(fs::is_symlink(path));
  CHECK(fs::is_symlink(path + ".part"));
  CHECK(std::distance(fs::directory_iterator(folder.path), {}) == 3);
}

TEST_CASE("files that are not regular files are refused") {
  const Folder folder;
  REQUIRE(::mkfifo((folder / "fifo").c_str(), 0666) == 0);
  sockaddr_un address{AF_UNIX, {}};
  (folder / "socket").copy(address.sun_path, sizeof address.sun_path - 1);
  const int socket = ::socket(AF_UNIX, SOCK_STREAM, 0);
  REQUIRE(::bind(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
  ::close(socket);
  const std::string expected = "; expected a regular file";
  for (const auto& [path, why] : {std::pair{folder / "fifo", "is a FIFO" + expected},
                                  {folder / "socket", "is a socket" + expected},
                                  {"/dev/zero", "is a device" + expected},
                                  {folder / "", "is a folder" + expected},
                                  {folder / "none", "cannot read: No such file or directory"}}) {
    CHECK_THROWS_WITH(RegularFile(path, ExitCode::failed), path + ": " + why);
    CHECK_THROWS_WITH(require_regular(path, ExitCode::failed), path + ": " + why);
  }
}

TEST_CASE("a regular file is read up to a limit, also through a link") {
  const Folder folder;
  std::ofstream(folder / "text") << "12345";
  fs::create_symlink("text", folder / "link");
  // For a file longer than the limit, rest() returns one byte more than the limit, so that the
  // caller can detect the excess.
  for (const std::size_t most : {0, 1, 4, 5, 6, 100})
    CHECK(RegularFile(folder / "link", ExitCode::failed).rest<std::string>(most) ==
          std::string("12345").substr(0, most + 1));
  std::ofstream(folder / "large") << std::string(100'000, 'x') << "end";
  const auto large = RegularFile(folder / "large", ExitCode::failed).rest<Bytes>();
  CHECK(large.size() == 100'003);
  CHECK(large.back() == 'd');
  // The kernel reports a size of 0 for this file.
  CHECK(RegularFile("/proc/self/maps", ExitCode::failed).rest<std::string>().size() > 100);
}

TEST_CASE("a FIFO that replaces a file while it is being opened is detected") {
  const Folder folder;
  const std::string path = folder.path / "a", file = folder.path / "file",
                    fifo = folder.path / "fifo";
  std::ofstream(file) << "text";
  REQUIRE(::mkfifo(fifo.c_str(), 0666) == 0);
  fs::create_symlink(file, path);
  std::atomic<bool> done = false;
  std::thread other([&] {
    for (int i = 0; !done; ++i) {
      fs::create_symlink(i % 2 ? file : fifo, path + ".new");
      fs::rename(path + ".new", path);
    }
  });
  int read = 0;
  for (int i = 0; i < 20'000; ++i) {
    try {
      const RegularFile now(path, ExitCode::failed);
      read += now.rest<std::string>() == "text" ? 1 : 100'000;
    } catch (const Error&) {
    }
  }
  done = true;
  other.join();
  CHECK(read > 0);
  CHECK(read <= 20'000);
}

TEST_CASE("a child process has the given folder and variables, and inherits no descriptors") {
  const Folder folder;
  const int mine = ::open("/dev/null", O_RDONLY);
  ::setenv("ECHOFUSE_TEST_WORD", "inherited", 1);
  ::setenv("ECHOFUSE_TEST_WORDS", "other", 1);
  // `ls` itself uses descriptor 3 to read the folder.
  const auto program = start_program(
      {"sh", "-c", "(pwd; ls /proc/self/fd; env | grep ECHOFUSE_TEST_WORD | sort) > out; exit 7"},
      {.folder = folder.path, .environment = {"ECHOFUSE_TEST_WORD=own"}});
  ::close(mine);
  ::unsetenv("ECHOFUSE_TEST_WORD"), ::unsetenv("ECHOFUSE_TEST_WORDS");
  REQUIRE(program);
  CHECK(wait_for_program(*program) == 7);
  CHECK(contents(folder / "out") ==
        folder.path.string() + "\n0\n1\n2\n3\nECHOFUSE_TEST_WORD=own\nECHOFUSE_TEST_WORDS=other\n");
  CHECK(wait_for_program(*start_program({"sh", "-c", "kill -9 $$"})) == 128 + 9);
  catch_interrupts();  // the signal handlers are not inherited by the child process
  CHECK(wait_for_program(*start_program({"sh", "-c", "kill -PIPE $$"})) == 128 + SIGPIPE);
  CHECK(start_program({"echofuse-no-such-program"}).failure().text() ==
        "echofuse-no-such-program: cannot start: No such file or directory");
}

TEST_CASE("a test case that hangs is aborted at its deadline",
          "[.]") {  // aborted by the deadline in tests/catch.cpp
  for (;;) ::pause();
}

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
  const auto refused = [](const std::string& path, const std::string& why) {
    CHECK_THROWS_WITH(RegularFile(path, ExitCode::failed), path + ": " + why);
    CHECK_THROWS_WITH(require_regular(path, ExitCode::failed), path + ": " + why);
  };
  REQUIRE(::mkfifo((folder.path / "fifo").c_str(), 0666) == 0);
  refused(folder.path / "fifo", "is a FIFO; expected a regular file");
  sockaddr_un address{AF_UNIX, {}};
  (folder.path / "socket").string().copy(address.sun_path, sizeof address.sun_path - 1);
  const int socket = ::socket(AF_UNIX, SOCK_STREAM, 0);
  REQUIRE(::bind(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
  refused(folder.path / "socket", "is a socket; expected a regular file");
  ::close(socket);
  refused("/dev/zero", "is a device; expected a regular file");
  refused(folder.path, "is a folder; expected a regular file");
  refused(folder.path / "none", "cannot read: No such file or directory");
  std::ofstream(folder.path / "text") << "12345";
  fs::create_symlink("text", folder.path / "link");
  const auto read = [&](std::size_t most) {
    return RegularFile(folder.path / "link", ExitCode::failed).rest<std::string>(most);
  };
  for (const std::size_t most : {5, 6, 100}) CHECK(read(most) == "12345");
  // For a file longer than the limit, rest() returns one byte more than the limit, so that the
  // caller can detect the excess.
  CHECK(read(4) == "12345");
  CHECK(read(1) == "12");
  CHECK(read(0) == "1");
  std::ofstream(folder.path / "large") << std::string(100'000, 'x') << "end";
  const auto large = RegularFile(folder.path / "large", ExitCode::failed).rest<Bytes>();
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

TEST_CASE("a variable for a child process replaces an inherited variable of this name") {
  const Folder folder;
  ::setenv("ECHOFUSE_TEST_WORD", "inherited", 1);
  ::setenv("ECHOFUSE_TEST_WORDS", "other", 1);
  const auto program =
      start_program({"sh", "-c", "env | grep ECHOFUSE_TEST_WORD | sort > out"},
                    {.folder = folder / "", .environment = {"ECHOFUSE_TEST_WORD=own"}});
  REQUIRE(program);
  CHECK(wait_for_program(*program) == 0);
  ::unsetenv("ECHOFUSE_TEST_WORD"), ::unsetenv("ECHOFUSE_TEST_WORDS");
  CHECK(contents(folder / "out") == "ECHOFUSE_TEST_WORD=own\nECHOFUSE_TEST_WORDS=other\n");
}

TEST_CASE("a child process starts in the given folder and inherits no file descriptors") {
  const Folder folder;
  const int mine = ::open("/dev/null", O_RDONLY);
  const auto program = start_program({"sh", "-c", "pwd > out; ls /proc/self/fd > fds; exit 7"},
                                     {.folder = folder.path});
  ::close(mine);
  REQUIRE(program);
  CHECK(wait_for_program(*program) == 7);
  CHECK(contents(folder.path / "out") == folder.path.string() + "\n");
  // `ls` itself uses descriptor 3 to read the folder.
  CHECK(contents(folder.path / "fds") == "0\n1\n2\n3\n");
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

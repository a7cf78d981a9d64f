// SPDX-License-Identifier: MIT
#include <fcntl.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "drivers/core/atomic_write.hpp"
#include "drivers/core/exit_code.hpp"
#include "drivers/core/program.hpp"

using namespace echofuse;
namespace fs = std::filesystem;

namespace {

struct Folder {
  Folder() {
    std::string name = (fs::temp_directory_path() / "echofuse-core-XXXXXX").string();
    path = ::mkdtemp(name.data());
  }
  ~Folder() { fs::remove_all(path); }
  fs::path path;
};

std::string text_of(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

TEST_CASE("a file is replaced as a whole, or stays as it was") {
  const Folder folder;
  const std::string path = folder.path / "a.txt";
  write_atomically(path, "old");
  CHECK(text_of(path) == "old");
  const auto cut = [](const std::string& part) {
    std::ofstream(part) << "ha";
    throw std::runtime_error("no more");
  };
  CHECK_THROWS_AS(write_atomically(path, cut), std::runtime_error);
  CHECK(text_of(path) == "old");
  write_atomically(path, "new");
  CHECK(text_of(path) == "new");
  CHECK_THROWS_AS(write_atomically(folder.path / "none" / "a.txt", "new"), Error);
}

TEST_CASE("a program is started in its folder with its input and no other file of ours") {
  const Folder folder;
  write_atomically(folder.path / "in", "hello\n");
  const int in = ::open((folder.path / "in").c_str(), O_RDONLY);
  const auto program =
      start_program({"sh", "-c", "read x; echo $x > out; ls /proc/self/fd > fds; exit 7"},
                    {.folder = folder.path, .input = in});
  ::close(in);
  REQUIRE(program);
  CHECK(wait_for_program(*program) == 7);
  CHECK(text_of(folder.path / "out") == "hello\n");
  CHECK(text_of(folder.path / "fds") == "0\n1\n2\n3\n");  // 3: ls reads the folder
  CHECK(wait_for_program(*start_program({"sh", "-c", "kill -9 $$"})) == 128 + 9);
  CHECK(start_program({"echofuse-no-such-program"}).failure().text() ==
        "echofuse-no-such-program: cannot start: No such file or directory");
}

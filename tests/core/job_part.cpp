// SPDX-License-Identifier: MIT
// Tests parts of a job array, and files that are published atomically.
#include "drivers/util/job_part.hpp"

#include "../fixtures/folder.hpp"
#include "../fixtures/full_disk.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/new_file.hpp"

using Catch::Contains;
namespace fs = std::filesystem;

namespace {

using test::contents;
using test::Folder;

// Changes TMPDIR for the lifetime of the object.
struct Scratch {
  const char* old = std::getenv("TMPDIR");
  const std::string before = old ? old : "";
  explicit Scratch(const fs::path& folder) { ::setenv("TMPDIR", folder.c_str(), 1); }
  ~Scratch() { old ? ::setenv("TMPDIR", before.c_str(), 1) : ::unsetenv("TMPDIR"); }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
};

int files_in(const fs::path& folder) {
  return static_cast<int>(std::distance(fs::directory_iterator(folder), {}));
}

}  // namespace

TEST_CASE("a job part is parsed from K/N, and other strings are refused") {
  CHECK(JobPart::of("2/4").name() == "part-2-of-4");
  for (const char* text : {"", "2", "0/4", "5/4", "1/0", "-1/4", "1/4x", "x/4", "1/", "/4",
                           "1/100001", "1/99999999999999999999", "auto"})
    CHECK_THROWS_WITH(JobPart::of(text), Contains("expected K/N with 1 <= K <= N"));
}

TEST_CASE("each work item belongs to exactly one job part") {
  for (const std::int64_t parts : {1, 3, 7, 50}) {
    std::int64_t next = 0;
    for (std::int64_t k = 1; k <= parts; ++k) {
      const auto range = JobPart::of(std::to_string(k) + "/" + std::to_string(parts)).range(17);
      CHECK(range.begin == next);
      next = range.end;
    }
    CHECK(next == 17);
  }
}

TEST_CASE("a new file appears only when complete, and leftovers of a killed process are replaced") {
  const Folder dir, scratch;
  const std::string place = dir / "a.sqlite";
  for (const bool elsewhere : {false, true}) {
    const Scratch tmp(elsewhere ? scratch.path : dir.path);
    std::ofstream(place) << "old";
    {
      const NewFile cut(place, NewFile::Staged{});
      std::ofstream(cut.path()) << "half";
      CHECK_THROWS_WITH(NewFile(place, NewFile::Staged{}),
                        Contains("another process is creating this file"));
    }
    CHECK(contents(place) == "old");
    std::string left;
    {
      NewFile file(place, NewFile::Staged{});
      left = file.path();
      std::ofstream(left) << "new";
      for (const char* beside : {"-wal", "-shm"}) std::ofstream(place + beside) << "no frames";
      CHECK(fs::path(left).parent_path() == (elsewhere ? scratch.path : dir.path));
      file.publish();
    }
    CHECK(contents(place) == "new");
    CHECK(files_in(dir.path) == 1);
    CHECK(files_in(scratch.path) == 0);
    std::ofstream(left) << "of a process that was killed";
    std::ofstream(left + "-wal") << "too";
    {
      const NewFile again(place, NewFile::Staged{});
      CHECK(again.path() == left);
      CHECK_FALSE(fs::exists(left));
      CHECK_FALSE(fs::exists(left + "-wal"));
    }
  }
}

TEST_CASE("a file that cannot be completed on a full disk leaves no temporary file") {
  const Folder dir, scratch;
  const std::string place = dir / "a.sqlite";
  const Scratch tmp(scratch.path);
  std::ofstream(place) << "old";
  {
    NewFile file(place, NewFile::Staged{});
    std::ofstream(file.path()) << std::string(100'000, 'x');
    const test::FullDisk disk(50'000);
    CHECK_THROWS_WITH(file.publish(), place + ": cannot be written: File too large");
  }
  CHECK(contents(place) == "old");
  CHECK(files_in(dir.path) == 1);
  CHECK(files_in(scratch.path) == 0);
}

TEST_CASE("a new file does not replace an existing file or inherit its SQLite side files") {
  const Folder dir;
  const std::string place = dir / "a", grows = dir / "a-new";
  NewFile file(place, grows);
  std::ofstream(grows) << "new";
  std::ofstream(place) << "another's", std::ofstream(place + "-wal") << "another's";
  CHECK_FALSE(file.publish_new());
  CHECK(contents(place) == "another's");
  CHECK(contents(place + "-wal") == "another's");
  fs::remove(place);
  CHECK(file.publish_new());
  CHECK(contents(place) == "new");
  CHECK(files_in(dir.path) == 1);
}

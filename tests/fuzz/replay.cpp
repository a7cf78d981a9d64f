// SPDX-License-Identifier: MIT
// fuzz_TARGET DIR: runs the target on every file of DIR, in a build without a fuzzer.
#include <sys/resource.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "fuzz.hpp"

int main(int argc, char** argv) {
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(argc > 1 ? argv[1] : ".")) {
    std::fprintf(stderr, "%s\n", entry.path().c_str());
    std::ifstream in(entry.path(), std::ios::binary);
    const echofuse::Bytes input{std::istreambuf_iterator<char>(in), {}};
    echofuse::fuzz::require(!in.bad() && in.is_open(), "the file can be read");
    echofuse::fuzz::run(input);
    ++files;
  }
  echofuse::fuzz::require(files > 0, "there are inputs");
  rusage used{};
  ::getrusage(RUSAGE_SELF, &used);
  echofuse::fuzz::require(used.ru_maxrss < 2 << 20, "memory is below 2 GiB, libFuzzer's limit");
}
